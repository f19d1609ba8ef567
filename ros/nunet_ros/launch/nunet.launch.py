"""`ros2 launch nunet_ros nunet.launch.py source:=/dev/video0 camera:=front`."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "source": "where frames come from",
    "image_topic": "a topic with images, instead of the source",
    "camera": "the first part of the topics' names",
    "calibration": "a camera calibration file",
    "mount": "x,y,z,roll,pitch,yaw of the camera in base_link",
    "topics": "default, all, or a list of topics",
}
"""Those that are given replace the values of the parameter file; by default they are empty."""


def nunet_node(context: LaunchContext) -> list[Node]:
    """The node with the parameter file and the arguments that were given."""
    values = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    given = {name: ParameterValue(value, value_type=str) for name, value in values.items() if value}
    parameters = [LaunchConfiguration("parameters"), *([given] if given else [])]
    return [
        Node(
            package="nunet_ros", executable="nunet_node", name="nunet", output="screen", parameters=parameters
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """The node, and RViz with `rviz:=true`."""
    share = FindPackageShare("nunet_ros")
    parameters = PathJoinSubstitution([share, "config", "nunet.yaml"])
    declared = [
        DeclareLaunchArgument(name, default_value="", description=description)
        for name, description in ARGUMENTS.items()
    ]
    return LaunchDescription(
        [
            *declared,
            DeclareLaunchArgument("parameters", default_value=parameters, description="a parameter file"),
            DeclareLaunchArgument("rviz", default_value="false", description="show the results"),
            OpaqueFunction(function=nunet_node),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", PathJoinSubstitution([share, "rviz", "nunet.rviz"])],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
