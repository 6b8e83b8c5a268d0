"""Moved to `study`; goes when the last experiment imports from there."""

from tsuiseki.trainers.experiments.study import interval as interval
