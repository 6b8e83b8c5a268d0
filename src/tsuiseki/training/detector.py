"""Training of the detector network: its module and its data module."""

from tsuiseki.datamodules.detector import DetectionData as DetectionData
from tsuiseki.trainers.detector import Detector as Detector
