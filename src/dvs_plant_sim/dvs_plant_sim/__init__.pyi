from dvs_plant_sim.disturbance import DisturbedPlant as DisturbedPlant
from dvs_plant_sim.dynamics import Dynamics as Dynamics
from dvs_plant_sim.fixed_step import FixedStep as FixedStep
from dvs_plant_sim.pendulum import Pendulum as Pendulum
from dvs_plant_sim.pendulum import PendulumConstants as PendulumConstants
from dvs_plant_sim.plant import Plant as Plant
