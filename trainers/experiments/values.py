"""Moved to `store`; goes when the last experiment imports from there."""

from tsuiseki.trainers.experiments.store import described as described
from tsuiseki.trainers.experiments.store import modules_of as modules_of
from tsuiseki.trainers.experiments.store import plain as plain
from tsuiseki.trainers.experiments.store import restored as restored
