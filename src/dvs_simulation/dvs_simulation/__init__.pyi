from dvs_simulation.exact.automaton import simulate
from dvs_simulation.exact.loop import ClosedLoop
from dvs_simulation.exact.signals import estimates_at, luminosities
from dvs_simulation.exact.trajectory import Outcome, Trajectory
from dvs_simulation.judging.trace import Trace
from dvs_simulation.judging.verdict import Verdict, judge
from dvs_simulation.sampled.sampled_loop import SampledRun, run_sampled
