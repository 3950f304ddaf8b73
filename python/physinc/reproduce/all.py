"""The experiments, in the paper's order."""

from .experiment import Experiment
from .rotation import EXPERIMENT as ROTATION
from .surfaces import EXPERIMENT as SURFACES

EXPERIMENTS: tuple[Experiment, ...] = (ROTATION, SURFACES)
