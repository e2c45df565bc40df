from dvs_plant_sim.disturbance import DisturbedPlant
from dvs_plant_sim.dynamics import Dynamics
from dvs_plant_sim.pendulum import Pendulum, PendulumConstants
from dvs_plant_sim.plant import Plant
