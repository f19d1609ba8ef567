"""`ros2 launch nunet_ros nunet.launch.py source:=/dev/video0 camera:=front`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "source": ("/dev/video0", "where frames come from"),
    "image_topic": ("", "a topic with images, instead of the source"),
    "camera": ("front", "the first part of the topics' names"),
    "calibration": ("", "a camera calibration file"),
    "mount": ("", "x,y,z,roll,pitch,yaw of the camera in base_link"),
    "topics": ("default", "default, all, or a list of topics"),
}


def generate_launch_description() -> LaunchDescription:
    """The node, and RViz with `rviz:=true`."""
    share = FindPackageShare("nunet_ros")
    parameters = PathJoinSubstitution([share, "config", "nunet.yaml"])
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    return LaunchDescription(
        [
            *declared,
            DeclareLaunchArgument("parameters", default_value=parameters, description="a parameter file"),
            DeclareLaunchArgument("rviz", default_value="false", description="show the results"),
            Node(
                package="nunet_ros",
                executable="nunet_node",
                name="nunet",
                output="screen",
                parameters=[LaunchConfiguration("parameters"), given],
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", PathJoinSubstitution([share, "rviz", "nunet.rviz"])],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
