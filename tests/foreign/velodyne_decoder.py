"""Decodes a pcap with velodyne-decoder (PyPI, 3.1.0), for comparison with this project's own decoder.

    python velodyne_decoder.py CAPTURE.pcap POINTS.bin

POINTS.bin: 24 bytes a point, little-endian, in the decoder's order: f64 seconds of the device's clock (as the decoder tells
them: the hour is that of the capture), f32 x, y, z, u8 ring, u8 return (1 strongest, 2 last, 3 both), u8 intensity, u8 0.
"""

import sys

# This file has the package's name: its own folder must not be where `import` looks first.
sys.path.pop(0)

import numpy
import velodyne_decoder

POINT = numpy.dtype(
    [("t", "<f8"), ("xyz", "<f4", 3), ("ring", "u1"), ("returned", "u1"), ("intensity", "u1"), ("pad", "u1")]
)


def main(capture, points):
    config = velodyne_decoder.Config(min_range=0.1, max_range=300.0)
    fields = velodyne_decoder.PointField
    with open(points, "wb") as out:
        for stamp, cloud in velodyne_decoder.read_pcap(capture, config):
            records = numpy.zeros(len(cloud), POINT)
            # Times of a turn's points are relative to its last packet's stamp.
            records["t"] = stamp.device + cloud[:, fields.time].astype(float)
            records["xyz"] = cloud[:, :3]
            records["ring"] = cloud[:, fields.ring]
            records["returned"] = cloud[:, fields.return_type]
            records["intensity"] = cloud[:, fields.intensity]
            records.tofile(out)


if __name__ == "__main__":
    main(*sys.argv[1:])
