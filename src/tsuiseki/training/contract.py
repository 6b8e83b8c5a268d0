"""What a network of one's own must have to be trained here."""

from tsuiseki.models.contract import ActionClassifier as ActionClassifier
from tsuiseki.models.contract import AppearanceTrunk as AppearanceTrunk
from tsuiseki.models.contract import DetectorNetwork as DetectorNetwork
from tsuiseki.models.contract import LinkCosts as LinkCosts
from tsuiseki.models.contract import NetworkCard as NetworkCard
