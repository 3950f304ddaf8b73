"""The experiments, in the paper's order."""

from .activity import EXPERIMENT as ACTIVITY
from .experiment import Experiment
from .laws import EXPERIMENT as LAWS
from .recordings import EXPERIMENT as RECORDINGS
from .rotation import EXPERIMENT as ROTATION
from .surfaces import EXPERIMENT as SURFACES
from .translation import EXPERIMENT as TRANSLATION

EXPERIMENTS: tuple[Experiment, ...] = (ROTATION, TRANSLATION, SURFACES, ACTIVITY, LAWS, RECORDINGS)
