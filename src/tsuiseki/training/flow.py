"""The minimum-cost flow as a layer, for features of one's own."""

from tsuiseki.trainers.flow.flow_layer import FlowLayer as FlowLayer
from tsuiseki.trainers.flow.flow_layer import FlowWindows as FlowWindows
from tsuiseki.trainers.flow.flow_loss import FlowLoss as FlowLoss
