"""Training of the action network: its module and its data module."""

from tsuiseki.datamodules.action import ActionData as ActionData
from tsuiseki.trainers.action import Action as Action
