#!/bin/sh
# A copying pipeline beside our hops, one after the other in one run. Needs Python 3.11 and the package registry.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../.." && pwd)
work="$root/target/peers/handover"
mkdir -p "$work"

"$work/venv/bin/python" -m pip --version > /dev/null 2>&1 || { rm -rf "$work/venv"; python3 -m venv "$work/venv"; }
"$work/venv/bin/pip" install --quiet --requirement "$here/requirements.txt"

(cd "$root" && cargo build --release --quiet --package mluc --package mluc-bench)
exec "$work/venv/bin/python" "$here/copy_pipeline.py" "$root/target/release/mluc" "$root/bench/record/handover.json" "${ROUNDS:-500}"
