"""Pictures, from result files alone."""

import warnings

# Debian's matplotlib beside PyPI's: only the 3-D axes, which are not used here, suffer
warnings.filterwarnings("ignore", message="Unable to import Axes3D")
