#!/bin/sh
# Our clusterers beside PCL's and scikit-learn's, on the same points. Needs Debian bookworm (PCL 1.13.0), g++, Python 3.11
# and the package registries; changes nothing of the system: packages are unpacked under target/peers.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../.." && pwd)
work="$root/target/peers/clustering"
mkdir -p "$work/debs"

if [ ! -x "$work/venv/bin/python" ]; then
    python3 -m venv "$work/venv"
    "$work/venv/bin/pip" install --quiet --requirement "$here/requirements.txt"
fi

# PCL's libraries alone: all that the package asks for would be a window system too.
pcl=1.13.0+dfsg-3
if [ ! -e "$work/pcl/done" ]; then
    (cd "$work/debs" && apt-get download --quiet \
        libpcl-dev=$pcl libpcl-common1.13=$pcl libpcl-kdtree1.13=$pcl libpcl-octree1.13=$pcl libpcl-search1.13=$pcl \
        libpcl-sample-consensus1.13=$pcl libpcl-filters1.13=$pcl libpcl-features1.13=$pcl libpcl-segmentation1.13=$pcl \
        libpcl-ml1.13=$pcl libflann-dev libflann1.9 libeigen3-dev libboost1.74-dev liblz4-1 liblz4-dev) \
        && for package in "$work"/debs/*.deb; do dpkg-deb -x "$package" "$work/pcl"; done \
        && touch "$work/pcl/done" \
        || echo "PCL $pcl cannot be had here: left out" >&2
fi
if [ -e "$work/pcl/done" ]; then
    library="$work/pcl/usr/lib/$(uname -m)-linux-gnu"
    if [ ! -x "$work/euclidean" ] || [ "$here/euclidean.cpp" -nt "$work/euclidean" ]; then
        g++ -std=c++17 -O3 -march=native -DNDEBUG \
            -isystem "$work/pcl/usr/include/pcl-1.13" -isystem "$work/pcl/usr/include/eigen3" -isystem "$work/pcl/usr/include" \
            -o "$work/euclidean" "$here/euclidean.cpp" \
            -L "$library" -Wl,-rpath,"$library" -Wl,--disable-new-dtags,--allow-shlib-undefined \
            -lpcl_segmentation -lpcl_search -lpcl_kdtree -lpcl_octree -lpcl_common -lflann_cpp -llz4
    fi
fi

clustering=${CLUSTERING:-}
if [ -z "$clustering" ]; then
    (cd "$root" && cargo build --release --quiet --package mluc-bench --bin clustering)
    clustering="$root/target/release/clustering"
fi
rm -rf "$work/candidates"
(cd "$root" && "$clustering" --out "$work/candidates")
exec "$work/venv/bin/python" "$here/compare.py" "$work" "$root/bench/record/clustering.json"
