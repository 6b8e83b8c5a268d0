"""Training of the association network: its module and its data module."""

from tsuiseki.trainers.association import Association as Association
from tsuiseki.trainers.flow.windows import AssociationData as AssociationData
