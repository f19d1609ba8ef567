"""Installs the package for `ros2 run` and `ros2 launch`."""

from setuptools import setup

setup(
    name="nunet_ros",
    version="0.1.0",
    packages=["nunet_ros"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/nunet_ros"]),
        ("share/nunet_ros", ["package.xml"]),
        ("share/nunet_ros/launch", ["launch/nunet.launch.py"]),
        ("share/nunet_ros/config", ["config/nunet.yaml"]),
        ("share/nunet_ros/rviz", ["rviz/nunet.rviz"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The nunet contributors",
    maintainer_email="nunet@localhost",
    description="Starts nunetd, which publishes depth, labels, clouds and obstacles of one color camera",
    license="MIT OR Apache-2.0",
    entry_points={"console_scripts": ["nunet_node = nunet_ros.node:main"]},
)
