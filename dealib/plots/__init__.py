"""Pictures of results; they read run directories and never import dolfinx."""

import warnings

# where Debian's matplotlib and PyPI's are both installed, only 3-D axes fail, which are not used
warnings.filterwarnings("ignore", message="Unable to import Axes3D")
