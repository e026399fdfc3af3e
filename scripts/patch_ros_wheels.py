"""Give the cmake files of the ROS wheels the include folders of this environment.

The wheels were built in a container: their cmake exports name the Python and NumPy folders of that container,
which exist nowhere else, so that no message package could be compiled against them.
"""

import re
import sys
import sysconfig
from pathlib import Path

import numpy as np

NUMPY = re.compile(r"/opt/python/[^;\"\s]*/numpy/_?core/include")
PYTHON = re.compile(r"/opt/python/[^;\"\s]*/include/python3\.\d+")


def main() -> int:
    """Rewrite every cmake file under the environment's share folder; fail when a foreign path is left."""
    left = []
    for path in sorted(Path(sys.prefix, "share").glob("*/cmake/*.cmake")):
        text = path.read_text()
        if "/opt/python/" not in text:
            continue
        text = NUMPY.sub(np.get_include(), text)
        text = PYTHON.sub(sysconfig.get_path("include"), text)
        path.write_text(text)
        if "/opt/python/" in text:
            left.append(path)
    for path in left:
        sys.stderr.write(f"{path}: names a folder of the container that built it\n")
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
