"""Names for training, each loaded when it is first used; lazy-loader and type checkers read this list."""

from .action import Action as Action
from .action import ActionData as ActionData
from .appearance import Appearance as Appearance
from .appearance import AppearanceData as AppearanceData
from .association import Association as Association
from .association import AssociationData as AssociationData
from .contract import ActionClassifier as ActionClassifier
from .contract import AppearanceTrunk as AppearanceTrunk
from .contract import DetectorNetwork as DetectorNetwork
from .contract import LinkCosts as LinkCosts
from .contract import NetworkCard as NetworkCard
from .detector import DetectionData as DetectionData
from .detector import Detector as Detector
from .flow import FlowLayer as FlowLayer
from .flow import FlowLoss as FlowLoss
from .flow import FlowWindows as FlowWindows
from .metrics import CLEAR as CLEAR
from .metrics import HOTA as HOTA
from .metrics import IDF1 as IDF1
from .metrics import ActionPrecision as ActionPrecision
from .metrics import AveragePrecision as AveragePrecision
from .metrics import ReIdentification as ReIdentification
from .tracker import Tracker as Tracker
from .tracker import TrackerData as TrackerData
