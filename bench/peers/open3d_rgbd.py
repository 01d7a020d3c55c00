#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Open3D on a folder of `render --format tum-rgbd`: frame-to-frame odometry and TSDF fusion (map.ply).

Methods: hybrid RGB-D odometry, colored ICP, point-to-plane ICP, generalized ICP. Needs python3-open3d, python3-numpy.
"""
import os

import numpy as np
import open3d as o3d
import rgbd_folder

MAP_VOXEL_M = 0.005
CLOUD_VOXEL_M = 0.01  # one point each for ICP
NORMAL_RADIUS_M = 0.02
ICP_DISTANCE_M = 0.05
METHODS = ["hybrid", "colored_icp", "point_to_plane", "gicp"]
registration = o3d.pipelines.registration


def main():
    options = rgbd_folder.arguments(__doc__, METHODS)
    camera = o3d.camera.PinholeCameraIntrinsic(*rgbd_folder.camera_matrix(options.folder))
    jacobian = o3d.pipelines.odometry.RGBDOdometryJacobianFromHybridTerm()
    settings = o3d.pipelines.odometry.OdometryOption()
    volume = o3d.pipelines.integration.ScalableTSDFVolume(
        MAP_VOXEL_M, 4 * MAP_VOXEL_M, o3d.pipelines.integration.TSDFVolumeColorType.RGB8)
    criteria = registration.ICPConvergenceCriteria(max_iteration=50)

    def image(rgb, depth, grey):
        return o3d.geometry.RGBDImage.create_from_color_and_depth(
            o3d.io.read_image(rgb), o3d.io.read_image(depth), rgbd_folder.DEPTH_UNITS_PER_M, rgbd_folder.FARTHEST_M, grey)

    def read(rgb, depth):
        color = image(rgb, depth, False)
        if options.method == "hybrid":
            return image(rgb, depth, True), color
        cloud = o3d.geometry.PointCloud.create_from_rgbd_image(color, camera).voxel_down_sample(CLOUD_VOXEL_M)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(NORMAL_RADIUS_M, 30))
        cloud.orient_normals_towards_camera_location()
        return cloud, color

    def register(last, current):
        target, source = last[0], current[0]
        if options.method == "hybrid":
            found, motion, _ = o3d.pipelines.odometry.compute_rgbd_odometry(
                source, target, camera, np.eye(4), jacobian, settings)
            return motion if found else None
        if options.method == "colored_icp":
            result = registration.registration_colored_icp(source, target, ICP_DISTANCE_M, np.eye(4),
                registration.TransformationEstimationForColoredICP(), criteria)
        elif options.method == "gicp":
            result = registration.registration_generalized_icp(source, target, ICP_DISTANCE_M, np.eye(4),
                registration.TransformationEstimationForGeneralizedICP(), criteria)
        else:
            result = registration.registration_icp(source, target, ICP_DISTANCE_M, np.eye(4),
                registration.TransformationEstimationPointToPlane(), criteria)
        return result.transformation if result.fitness > 0.1 else None

    for _, (_, color), pose in rgbd_folder.odometry(options.out, options.folder, read, register):
        volume.integrate(color, camera, np.linalg.inv(pose))
    o3d.io.write_triangle_mesh(os.path.join(options.out, "map.ply"), volume.extract_triangle_mesh())


if __name__ == "__main__":
    main()
