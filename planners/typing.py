"""The array type of the whole project."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
