#!/bin/sh
# Makes .venv-devkit: the official nuScenes devkit, apart from the project because it needs numpy < 2.
# motmetrics, which the devkit's tracking evaluation needs and does not name: 1.1.3 was right for devkits up to 1.1.11, 1.2.0 calls 1.4.0.
# Usage: tools/devkit/setup.sh [python3.11]
set -eu
cd "$(dirname "$0")/../.."
python=${1:-python3.11}
command -v "$python" >/dev/null || { echo "error: no $python; name one: tools/devkit/setup.sh PYTHON" >&2; exit 1; }
[ -x .venv-devkit/bin/python ] || "$python" -m venv .venv-devkit
.venv-devkit/bin/python -m pip install --quiet --disable-pip-version-check nuscenes-devkit==1.2.0 motmetrics==1.4.0 'pandas<3'
.venv-devkit/bin/python -c "import nuscenes" && echo "ready: .venv-devkit/bin/python tools/devkit/check.py --root data/nano"
