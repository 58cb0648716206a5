#!/usr/bin/env bash
# Makes .venv-tools: ruff, mypy and the types that mypy reads, all pinned (setup/tools.txt).
# Idempotent and silent when all is there.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
stamp=.venv-tools/.setup-done

wanted() { cat setup/tools.txt setup/tools.sh; /usr/bin/python3 --version; pwd; }

[ -f "$stamp" ] && [ "$(wanted | cksum)" = "$(cat "$stamp")" ] && exit 0

echo "setup: installing ruff and mypy"
/usr/bin/python3 -m venv --without-pip --clear .venv-tools
.venv/bin/python -m pip --python .venv-tools/bin/python install --quiet --no-deps --no-compile \
  --disable-pip-version-check --requirement setup/tools.txt >.venv-tools/pip.log 2>&1 ||
  { tail -n 20 .venv-tools/pip.log >&2; echo "setup: pip failed, see .venv-tools/pip.log" >&2; exit 4; }
wanted | cksum >"$stamp"
