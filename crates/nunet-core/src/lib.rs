//! From a picture to metric depth and a point cloud.
