"""Training of the Siamese tracker: its module and its data module."""

from tsuiseki.datamodules.tracker import TrackerData as TrackerData
from tsuiseki.trainers.tracker import Tracker as Tracker
