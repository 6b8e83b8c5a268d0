"""Moved to `study`; goes when the last experiment imports from there."""

from tsuiseki.trainers.experiments.study import Bench as Bench
from tsuiseki.trainers.experiments.study import Outcome as Outcome
from tsuiseki.trainers.experiments.study import Table as Table
from tsuiseki.trainers.experiments.study import Watch as Watch
from tsuiseki.trainers.experiments.study import at_least_one as at_least_one
from tsuiseki.trainers.experiments.study import png as png
