"""Makes the files that src/files/tests.rs reads, with laspy: pip install laspy lazrs; python3 make.py

Three points with intensities of 16 bits, in a map's coordinates: the sensor is at 500000, 5400000, 100.
"""
import laspy
import numpy as np

POINTS = [(1.0, 2.0, 3.0, 0.5), (-4.0, 5.5, -6.0, 0.25), (7.0, -8.0, 9.0, 1.0)]

for version, kind, name in [("1.2", 1, "1.las"), ("1.4", 6, "6.las"), ("1.2", 3, "3.laz"), ("1.4", 7, "7.las")]:
    header = laspy.LasHeader(version=version, point_format=kind)
    header.scales, header.offsets = [0.001] * 3, [500_000.5, 5_400_000, 0]
    if name == "7.las":
        header.add_extra_dim(laspy.ExtraBytesParams(name="ring", type=np.uint16))
    las = laspy.LasData(header)
    las.x, las.y, las.z, las.intensity = (np.array(axis) for axis in zip(
        *((500_000 + x, 5_400_000 + y, 100 + z, round(i * 65535)) for x, y, z, i in POINTS)))
    las.write(name)
