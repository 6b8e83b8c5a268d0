"""Scores as `torchmetrics.Metric`, of tracks, detections, appearance and actions."""

from tsuiseki.trainers.metrics.actions import ActionPrecision as ActionPrecision
from tsuiseki.trainers.metrics.detections import AveragePrecision as AveragePrecision
from tsuiseki.trainers.metrics.reidentification import ReIdentification as ReIdentification
from tsuiseki.trainers.metrics.tracks import CLEAR as CLEAR
from tsuiseki.trainers.metrics.tracks import HOTA as HOTA
from tsuiseki.trainers.metrics.tracks import IDF1 as IDF1
