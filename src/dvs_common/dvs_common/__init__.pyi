from dvs_common.errors import ParameterError
from dvs_common.scenario.model import Equilibrium, PixelScene, PlantModel
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_common.scenario.scenario import Scenario, load_scenario
from dvs_common.wire.events import EventPacket, make_events, pack_events, parse_events
from dvs_common.wire.index_watch import IndexWatch
from dvs_common.wire.keyframe import Keyframe
