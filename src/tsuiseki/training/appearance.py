"""Training of the appearance network: its module and its data module."""

from tsuiseki.datamodules.appearance import AppearanceData as AppearanceData
from tsuiseki.trainers.appearance import Appearance as Appearance
