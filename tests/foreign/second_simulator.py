"""A simulator that shares nothing with this project's own: Open3D casts the rays, NumPy makes the noise.

    python second_simulator.py FOLDER [key=value ...]

Writes into FOLDER what a rig would have recorded: velodyne.pcap (a VLP-32C on UDP 2368 and 8308), kinect/ (a fakenect folder of
raw 11-bit frames), rig.toml (what an operator has: a mounting off by 0.4 degrees and 6 mm, a stamp by up to 2 ms), rig-true.toml
and truth.csv. The LiDAR's clock knows no wall time and passes the hour 20 s after the start; 0.5 % of packets and 1 % of frames are
lost; some arrive late; every beam has a bias.

Keys: target (probe, lander), motion (spin, tumble), seconds, rate_dps, lean_deg, distance_m, room (0, 1), beam_bias_m, kinect (0, 1),
seed.
"""

import pathlib
import struct
import sys

import numpy
import open3d
from scipy.ndimage import uniform_filter
from scipy.spatial.transform import Rotation

WALL_S = 1_790_000_000.0
FRAME_S, SEQUENCE_S, BLOCKS = 1.0 / 30.0, 55.296e-6, 12
# VLP-32C user manual 63-9325, table 9-5: elevation and azimuth offset of each laser, degrees.
ELEVATIONS = [-25, -1, -1.667, -15.639, -11.31, 0, -0.667, -8.843, -7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667, -4,
              -4.667, 1.667, 1, -3.667, -3.333, 3.333, 2.333, -2.667, -3, 7, 4.667, -2.333, -2, 15, 10.333, -1.333]
OFFSETS = [1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4,
           1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4, 1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4]
ROOM_AXES = numpy.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])  # a camera's axes in the rig's, looking along x


def euler(axes, degrees):
    return Rotation.from_euler(axes, degrees, degrees=True).as_matrix()


def placed(mesh, place, turn=None):
    if turn is not None:
        mesh.rotate(turn, (0, 0, 0))
    return mesh.translate(place)


def box(place, size, turn=None):
    return placed(open3d.geometry.TriangleMesh.create_box(*size).translate([-s / 2 for s in size]), place, turn)


def cylinder(radius, height, place, sides=32):
    return placed(open3d.geometry.TriangleMesh.create_cylinder(radius, height, sides, 2), place)


def probe():
    mesh = box((0, 0, 0), (0.5, 0.38, 0.42))
    mesh += box((0.05, -0.55, 0.02), (0.32, 0.55, 0.02), euler("y", 30)) + box((0, -0.24, 0), (0.03, 0.12, 0.03))
    mesh += placed(open3d.geometry.TriangleMesh.create_cone(0.20, 0.10, 32, 3), (0.30, 0.02, 0.05), euler("y", 90))
    mesh += box((-0.05, 0.05, 0.27), (0.2, 0.12, 0.12)) + cylinder(0.015, 0.35, (-0.15, 0.12, 0.35))
    return mesh + box((-0.3, -0.08, -0.1), (0.1, 0.12, 0.16))


def lander():
    mesh = open3d.geometry.TriangleMesh.create_cylinder(0.30, 0.35, 8, 2)
    for degrees, length in ((20, 0.45), (140, 0.45), (260, 0.30)):
        leg = box((0.36, 0, -0.25), (0.03, 0.03, length), euler("y", 25))
        mesh += leg.rotate(euler("z", degrees), (0, 0, 0))
    mesh += box((0, 0.55, 0.05), (0.30, 0.45, 0.015), euler("x", 15)) + box((0, 0.31, 0.05), (0.03, 0.1, 0.03))
    return mesh + cylinder(0.11, 0.14, (0.05, -0.08, 0.24)) + box((-0.18, -0.05, 0.22), (0.10, 0.14, 0.10))


def room(center):
    """A floor, two walls, a table, and a round plate on a column under the target."""
    floor = -1.1
    return [box((3, 0, floor - 0.05), (12, 8, 0.1)), box((5.2, 0, 0.5), (0.1, 8, 4)), box((2, 3.4, 0.5), (10, 0.1, 4)),
            box((3.9, -1.6, -0.4), (0.5, 0.9, 1.4)), cylinder(0.06, 0.55, (center[0], center[1], floor + 0.28)),
            cylinder(0.25, 0.04, (center[0], center[1], floor + 0.56))]


class Solid:
    def __init__(self, meshes):
        self.scene = open3d.t.geometry.RaycastingScene(2)
        for mesh in meshes:
            mesh.compute_triangle_normals()
            self.scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(mesh))

    def cast(self, origin, ways):
        """How far along each way it is hit, and the cosine of incidence."""
        rays = numpy.concatenate([numpy.broadcast_to(origin, ways.shape), ways], 1).astype(numpy.float32)
        found = self.scene.cast_rays(open3d.core.Tensor(rays))
        cosines = numpy.abs((found["primitive_normals"].numpy() * ways).sum(1)) / numpy.linalg.norm(ways, axis=1)
        return found["t_hit"].numpy().astype(float), cosines


class Spin:
    """About an axis that leans, a little beside the target's own middle."""

    def __init__(self, center, rate_dps, axis):
        self.center, self.rate_rps, self.axis = center, numpy.deg2rad(rate_dps), axis
        self.start = Rotation.from_rotvec(numpy.deg2rad([4, -7, 30]))

    def at(self, t):
        turn = Rotation.from_rotvec(numpy.outer(numpy.atleast_1d(t) * self.rate_rps, self.axis))
        return (turn * self.start).as_matrix(), self.center + turn.apply(numpy.tile([0.03, -0.02, 0.01], (numpy.size(t), 1)))

    def rate(self, t):
        return self.axis * self.rate_rps


class Tumble:
    """Free of torque, by the midpoint rule in steps of 2 ms; between them at an even rate."""

    STEP_S, BEFORE_S = 0.002, 1.0

    def __init__(self, center, rate_dps, seconds):
        self.center, inertia = center, numpy.array([1.0, 1.35, 0.8])
        rate = numpy.array([0.45, 0.8, -0.35])
        rate *= numpy.deg2rad(rate_dps) / numpy.linalg.norm(rate)
        attitude, steps = Rotation.from_rotvec(numpy.deg2rad([4, -7, 30])), int((seconds + 3) / self.STEP_S)
        self.attitudes, self.rates = numpy.empty((steps, 3, 3)), numpy.empty((steps, 3))
        torque = lambda w: -numpy.cross(w, inertia * w) / inertia
        for step in range(steps):
            self.attitudes[step], self.rates[step] = attitude.as_matrix(), attitude.apply(rate)
            middle = rate + self.STEP_S / 2 * torque(rate)
            attitude, rate = attitude * Rotation.from_rotvec(middle * self.STEP_S), rate + self.STEP_S * torque(middle)

    def at(self, t):
        steps = (numpy.atleast_1d(t) + self.BEFORE_S) / self.STEP_S
        whole = steps.astype(int)
        left = ((steps - whole) * self.STEP_S)[:, None] * self.rates[whole]
        attitudes = Rotation.from_rotvec(left) * Rotation.from_matrix(self.attitudes[whole])
        return attitudes.as_matrix(), numpy.tile(self.center, (len(steps), 1))

    def rate(self, t):
        return self.rates[int((t + self.BEFORE_S) / self.STEP_S)]


class Capture:
    """A pcap file of UDP packets, in the order and not before the time at which they arrive."""

    def __init__(self, path):
        self.file, self.last_s = open(path, "wb"), 0.0
        self.file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1))

    def add(self, port, payload, arrived_s):
        self.last_s = max(arrived_s, self.last_s + 2e-6)
        udp = struct.pack(">HHHH", port, port, 8 + len(payload), 0) + payload
        addresses = bytes([192, 168, 1, 201]), bytes([255] * 4)
        ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0x4000, 255, 17, 0, *addresses)
        frame = b"\xff" * 6 + b"\x60\x76\x88\x01\x02\x03\x08\x00" + ip + udp
        micros = round((WALL_S + self.last_s) * 1e6)
        self.file.write(struct.pack("<IIII", micros // 10**6, micros % 10**6, len(frame), len(frame)) + frame)
        return self.last_s


def lidar(path, target, around, motion, options, chance):
    """Writes the LiDAR's packets; returns when the first one arrived."""
    elevations, offsets = numpy.deg2rad(ELEVATIONS), numpy.deg2rad(OFFSETS)
    fires = 2.304e-6 * (numpy.arange(32) // 2)
    biases = chance.standard_normal(32) * options["beam_bias_m"]
    capture, first, start_deg, slope_dps = Capture(path), None, chance.uniform(0, 360), 3600.0
    packets, at_once = int(options["seconds"] / (BLOCKS * SEQUENCE_S)), 200
    block = numpy.dtype([("id", "<u2"), ("azimuth", "<u2"), ("returns", [("distance", "<u2"), ("intensity", "u1")], 32)])
    for begin in range(0, packets, at_once):
        count = min(at_once, packets - begin)
        blocks_s = (numpy.arange(begin, begin + count)[:, None] * BLOCKS + numpy.arange(BLOCKS)) * SEQUENCE_S
        t = blocks_s[:, :, None] + fires
        azimuths = numpy.deg2rad(start_deg + slope_dps * t) + offsets
        flat = numpy.cos(elevations)
        ways = numpy.stack([flat * numpy.cos(azimuths), -flat * numpy.sin(azimuths), numpy.sin(elevations) + 0 * azimuths], -1)
        ways, t = ways.reshape(-1, 3), t.reshape(-1)
        ranges, cosines = around.cast(numpy.zeros(3), ways)
        ahead = numpy.flatnonzero(numpy.abs(numpy.arctan2(ways[:, 1], ways[:, 0])) < 0.6)
        turns, places = motion.at(t[ahead])
        into = lambda vectors: numpy.einsum("kji,kj->ki", turns, vectors)
        near, incidence = target.cast(into(-places), into(ways[ahead]))
        is_target = near < ranges[ahead]
        ranges[ahead[is_target]], cosines[ahead[is_target]] = near[is_target], incidence[is_target]
        ranges = ranges + (0.015 + 0.01 * (cosines < 0.35)) * chance.standard_normal(ranges.shape)
        ranges += numpy.tile(biases, count * BLOCKS)
        is_lost = ~numpy.isfinite(ranges) | (ranges < 0.5) | (cosines < 0.08) | (chance.random(ranges.shape) < 0.004)
        data = numpy.zeros((count, BLOCKS), block)
        data["id"] = 0xEEFF
        data["azimuth"] = numpy.round((start_deg + slope_dps * blocks_s) % 360 * 100).astype(int) % 36000
        steps = numpy.round(numpy.where(is_lost, 0, ranges) / 0.004).clip(0, 65535)
        data["returns"]["distance"] = steps.reshape(count, BLOCKS, 32)
        data["returns"]["intensity"] = chance.integers(5, 90, (count, BLOCKS, 32))
        for number in range(count):
            sent_s = blocks_s[number, 0]
            stamp = int(3_580_000_000 + sent_s * 1e6 * (1 + 17e-6)) % 3_600_000_000
            arrived_s = sent_s + BLOCKS * SEQUENCE_S + 3.2e-4 + chance.exponential(2e-4)
            arrived_s += chance.uniform(0.002, 0.012) if chance.random() < 0.001 else 0.0
            if chance.random() < 0.005:
                continue
            arrived_s = capture.add(2368, data[number].tobytes() + struct.pack("<IBB", stamp, 0x37, 0x28), arrived_s)
            first = arrived_s if first is None else first
            if (begin + number) % 14 == 0:
                position = bytearray(512)
                position[0xC6:0xCA] = struct.pack("<I", stamp)
                capture.add(8308, bytes(position), arrived_s)
    capture.file.close()
    return first


CAMERA = dict(fx=578.2, fy=577.4, cx=321.3, cy=238.1)
LATE_S = 0.034


def disparities(depths, cosines, chance):
    """Raw 11-bit values of depths, m, infinite where there is nothing: noise, torn edges, flying pixels, the projector's shadow."""
    height, width = depths.shape
    is_there = numpy.isfinite(depths) & (depths > 0.45) & (depths < 7)
    far = numpy.where(is_there, depths, 1e3)
    rows, columns = numpy.indices(depths.shape)
    warped = far + 0.0025 * numpy.sin(columns / width * 3.1 + rows / height * 2.2) * far * far
    noise = uniform_filter(chance.standard_normal(depths.shape), 3) * 1.8 + chance.standard_normal(depths.shape) * 0.25
    raw = numpy.round(1089.408 - 1 / (2.894444e-3 * warped) + 0.48 * noise)
    across = numpy.abs(numpy.diff(far, axis=1, prepend=far[:, :1])) > 0.05
    down = numpy.abs(numpy.diff(far, axis=0, prepend=far[:1])) > 0.05
    edge = across | down
    edge[:, :-1] |= across[:, 1:]
    edge[:-1] |= down[1:]
    is_lost = (edge & (chance.random(depths.shape) < 0.55)) | (cosines < 0.2) | ~is_there
    behind = numpy.diff(1 / far, axis=1)
    for row, column in zip(*numpy.nonzero(behind < -0.03)):
        is_lost[row, column + 1 : column + 1 + int(-43.2 * behind[row, column])] = True
    is_lost[:, 632:] = True
    flies = edge & ~is_lost & (chance.random(depths.shape) < 0.3)
    raw = numpy.where(flies, raw + chance.integers(0, 25, depths.shape), raw)
    return numpy.where(is_lost, 2047, raw.clip(0, 1054)).astype("<u2")


def kinect(folder, target, around, motion, options, mounting, chance):
    """Writes the Kinect's frames; returns when the first one arrived."""
    turn, place = mounting
    folder.mkdir()
    rows, columns = numpy.mgrid[0:480, 0:640]
    ways = numpy.stack([(columns - CAMERA["cx"]) / CAMERA["fx"], (rows - CAMERA["cy"]) / CAMERA["fy"], numpy.ones((480, 640))], -1)
    ways = ways.reshape(-1, 3) @ turn.T
    empty, empty_cosines = around.cast(place, ways)
    sight = (motion.center - place) @ turn
    middle = sight[:2] / sight[2] * [CAMERA["fx"], CAMERA["fy"]] + [CAMERA["cx"], CAMERA["cy"]]
    aside = numpy.hypot(columns - middle[0], rows - middle[1]) < CAMERA["fx"] / sight[2]
    ahead = numpy.flatnonzero(aside.reshape(-1))
    first, ticks_at_start, names = None, int(chance.integers(0, 2**32)), []
    for frame in range(int(options["seconds"] / FRAME_S) if options["kinect"] else 1):
        t = 0.005 + frame * FRAME_S
        turns, places = motion.at(t)
        depths, cosines = empty.copy(), empty_cosines.copy()
        near, incidence = target.cast((place - places[0]) @ turns[0], ways[ahead] @ turns[0])
        is_target = near < depths[ahead]
        depths[ahead[is_target]], cosines[ahead[is_target]] = near[is_target], incidence[is_target]
        raw = disparities(depths.reshape(480, 640), cosines.reshape(480, 640), chance)
        arrived_s = t + LATE_S + chance.exponential(6e-4) + (chance.uniform(0.001, 0.008) if chance.random() < 0.01 else 0.0)
        if chance.random() < 0.01:
            continue
        first = arrived_s if first is None else first
        ticks = (ticks_at_start + round(t * 60e6 * (1 - 28e-6))) % 2**32
        names.append(f"d-{WALL_S + arrived_s:.6f}-{ticks}.pgm")
        (folder / names[-1]).write_bytes(b"P5 640 480 65535\n" + raw.tobytes())
    (folder / "INDEX.txt").write_text("".join(name + "\n" for name in names))
    return first


def rig(mounting, late_s, center):
    turn, place = mounting
    numbers = lambda values: "[" + ", ".join(f"{value:.9f}" for value in values) + "]"
    lens = ", ".join(f"{key} = {value}" for key, value in CAMERA.items())
    return f"""[[lidar]]
id = "front"
vertical_offsets = "off"
[[kinect]]
id = "near"
intrinsics = {{ {lens}, k1 = 0.0, k2 = 0.0, p1 = 0.0, p2 = 0.0, k3 = 0.0 }}
t_rig_kinect = {{ translation_m = {numbers(place)}, rotation_xyzw = {numbers(Rotation.from_matrix(turn).as_quat())} }}
time_offset_ms = {late_s * 1e3:.6f}
[target]
roi_center_m = {numbers(center)}
roi_radius_m = 0.95
"""


def direction(chance):
    vector = chance.standard_normal(3)
    return vector / numpy.linalg.norm(vector)


def main(folder, options):
    chance = numpy.random.default_rng(options["seed"])
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True)
    center = numpy.array([options["distance_m"], 0.1, 0.05])
    target = Solid([{"probe": probe, "lander": lander}[options["target"]]()])
    around = Solid(room(center) if options["room"] else [box((40, 0, 0), (0.1, 60, 60))])
    if options["motion"] == "spin":
        motion = Spin(center, options["rate_dps"], euler("xy", [options["lean_deg"] * 0.5, options["lean_deg"] * 0.866])[:, 2])
    else:
        motion = Tumble(center, options["rate_dps"], options["seconds"])
    mounting = euler("z", -9) @ euler("y", 3) @ ROOM_AXES, numpy.array([0.12, 0.42, 0.06])
    off = Rotation.from_rotvec(direction(chance) * numpy.deg2rad(0.4)).as_matrix()
    believed = off @ mounting[0], mounting[1] + direction(chance) * 0.006
    (folder / "rig-true.toml").write_text(rig(mounting, LATE_S, center))
    (folder / "rig.toml").write_text(rig(believed, LATE_S + chance.uniform(-0.002, 0.002), center))
    first = lidar(folder / "velodyne.pcap", target, around, motion, options, chance)
    first = min(first, kinect(folder / "kinect", target, around, motion, options, mounting, chance))
    with open(folder / "truth.csv", "w") as truth:
        truth.write("t_ns,unix_ns,px,py,pz,qx,qy,qz,qw,wx,wy,wz\n")
        for t in numpy.arange(-0.5, options["seconds"] + 0.5, 0.005):
            turns, places = motion.at(t)
            numbers = (*places[0], *Rotation.from_matrix(turns[0]).as_quat(), *motion.rate(t))
            times = f"{round((t - first) * 1e9)},{round(WALL_S) * 10**9 + round(t * 1e9)}"
            truth.write(times + "".join(f",{number:.9f}" for number in numbers) + "\n")


if __name__ == "__main__":
    given = dict(argument.split("=") for argument in sys.argv[2:])
    usual = dict(target="probe", motion="spin", seconds=60.0, rate_dps=9.0, lean_deg=7.0, distance_m=2.4, room=1, beam_bias_m=0.008,
                 kinect=1, seed=1)
    if not given.keys() <= usual.keys():
        sys.exit(f"unknown: {sorted(given.keys() - usual.keys())}")
    main(sys.argv[1], usual | {key: type(usual[key])(value) for key, value in given.items()})
