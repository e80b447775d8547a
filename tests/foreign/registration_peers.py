"""Registers stored pairs with small_gicp (PyPI, 1.0.1) and Open3D (0.20.0), for comparison with this project's own methods.

    python registration_peers.py FOLDER POSES.jsonl

FOLDER holds NNNN-kinect.ply (moving), NNNN-lidar.ply (reference) and NNNN-prior.json, as `tumbled experiment registration
--store` writes them, and settings.json: for `icp`, `plane-icp` and `gicp` which cloud is the target (`denser` or `sparser`),
max_distance_m, rotation_epsilon_rad, translation_epsilon_m, max_iterations and neighbours.
POSES.jsonl: a line for each pair and peer, with `pair`, `method`, `peer` and `t_reference_moving`, four rows of four.
"""

import json
import pathlib
import sys

import numpy
import open3d
import small_gicp

registration = open3d.pipelines.registration


def of_small_gicp(kind):
    def align(target, source, start, settings):
        clouds = [small_gicp.PointCloud(points) for points in (target, source)]
        trees = [small_gicp.KdTree(cloud) for cloud in clouds]
        for cloud, tree in zip(clouds, trees):
            small_gicp.estimate_normals_covariances(cloud, tree, settings["neighbours"])
        found = small_gicp.align(
            clouds[0],
            clouds[1],
            trees[0],
            start,
            registration_type=kind,
            max_correspondence_distance=settings["max_distance_m"],
            max_iterations=settings["max_iterations"],
            rotation_epsilon=settings["rotation_epsilon_rad"],
            translation_epsilon=settings["translation_epsilon_m"],
        )
        return found.T_target_source

    return align


def of_open3d(estimation):
    def align(target, source, start, settings):
        clouds = [open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points)) for points in (target, source)]
        clouds[0].estimate_normals(open3d.geometry.KDTreeSearchParamKNN(settings["neighbours"]))
        # It ends by the change of its error, and has no bounds on a step.
        criteria = registration.ICPConvergenceCriteria(max_iteration=settings["max_iterations"])
        found = registration.registration_icp(
            clouds[1], clouds[0], settings["max_distance_m"], start, estimation, criteria
        )
        return found.transformation

    return align


PEERS = [
    ("icp", "small_gicp ICP", of_small_gicp("ICP")),
    ("icp", "Open3D point to point", of_open3d(registration.TransformationEstimationPointToPoint())),
    ("plane-icp", "small_gicp PLANE_ICP", of_small_gicp("PLANE_ICP")),
    ("plane-icp", "Open3D point to plane", of_open3d(registration.TransformationEstimationPointToPlane())),
    ("gicp", "small_gicp GICP", of_small_gicp("GICP")),
]


def points(path):
    return numpy.asarray(open3d.io.read_point_cloud(str(path)).points)


def pose(path):
    known = json.loads(path.read_text())["t_reference_moving"]
    x, y, z, w = known["rotation_xyzw"]
    matrix = numpy.eye(4)
    matrix[:3, :3] = open3d.geometry.get_rotation_matrix_from_quaternion(numpy.array([w, x, y, z]))
    matrix[:3, 3] = known["translation_m"]
    return matrix


def main(folder, poses):
    folder = pathlib.Path(folder)
    settings = json.loads((folder / "settings.json").read_text())
    with open(poses, "w") as out:
        for path in sorted(folder.glob("*-prior.json")):
            number = path.name.split("-")[0]
            moving, reference = points(folder / f"{number}-kinect.ply"), points(folder / f"{number}-lidar.ply")
            prior = pose(path)
            for method, peer, align in PEERS:
                of_method = settings[method]
                moving_is_target = (len(moving) > len(reference)) == (of_method["target"] == "denser")
                if moving_is_target:
                    found = numpy.linalg.inv(align(moving, reference, numpy.linalg.inv(prior), of_method))
                else:
                    found = align(reference, moving, prior, of_method)
                line = {"pair": int(number), "method": method, "peer": peer, "t_reference_moving": found.tolist()}
                out.write(json.dumps(line) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
