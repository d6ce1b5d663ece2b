"""Definitions of ROS 2's own messages, for bags that do not hold them (`.db3` before ROS 2 Iron).

The fields and their order are those of the packages `builtin_interfaces`, `std_msgs`,
`geometry_msgs`, `sensor_msgs` and `nav_msgs`. Only messages are here whose layout has been the same
in every release from Dashing to Lyrical; `sensor_msgs/Range`, say, has not.
"""

__all__ = ["definition"]

# Fields in order: a type and the names that have it.
FIELDS = {
    "builtin_interfaces/Time": "int32 sec; uint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec; uint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp; string frame_id",
    "std_msgs/Bool": "bool data",
    "std_msgs/Int8": "int8 data",
    "std_msgs/Int16": "int16 data",
    "std_msgs/Int32": "int32 data",
    "std_msgs/Int64": "int64 data",
    "std_msgs/UInt8": "uint8 data",
    "std_msgs/UInt16": "uint16 data",
    "std_msgs/UInt32": "uint32 data",
    "std_msgs/UInt64": "uint64 data",
    "std_msgs/Float32": "float32 data",
    "std_msgs/Float64": "float64 data",
    "std_msgs/String": "string data",
    "std_msgs/MultiArrayDimension": "string label; uint32 size stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim; uint32 data_offset",
    "std_msgs/Int32MultiArray": "std_msgs/MultiArrayLayout layout; int32[] data",
    "std_msgs/Float32MultiArray": "std_msgs/MultiArrayLayout layout; float32[] data",
    "std_msgs/Float64MultiArray": "std_msgs/MultiArrayLayout layout; float64[] data",
    "geometry_msgs/Vector3": "float64 x y z",
    "geometry_msgs/Vector3Stamped": "std_msgs/Header header; geometry_msgs/Vector3 vector",
    "geometry_msgs/Point": "float64 x y z",
    "geometry_msgs/PointStamped": "std_msgs/Header header; geometry_msgs/Point point",
    "geometry_msgs/Quaternion": "float64 x y z w",
    "geometry_msgs/QuaternionStamped": (
        "std_msgs/Header header; geometry_msgs/Quaternion quaternion"
    ),
    "geometry_msgs/Pose": "geometry_msgs/Point position; geometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header; geometry_msgs/Pose pose",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose; float64[36] covariance",
    "geometry_msgs/PoseWithCovarianceStamped": (
        "std_msgs/Header header; geometry_msgs/PoseWithCovariance pose"
    ),
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear angular",
    "geometry_msgs/TwistStamped": "std_msgs/Header header; geometry_msgs/Twist twist",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist; float64[36] covariance",
    "geometry_msgs/TwistWithCovarianceStamped": (
        "std_msgs/Header header; geometry_msgs/TwistWithCovariance twist"
    ),
    "geometry_msgs/Accel": "geometry_msgs/Vector3 linear angular",
    "geometry_msgs/AccelStamped": "std_msgs/Header header; geometry_msgs/Accel accel",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header; geometry_msgs/Wrench wrench",
    "geometry_msgs/Transform": (
        "geometry_msgs/Vector3 translation; geometry_msgs/Quaternion rotation"
    ),
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header; string child_frame_id; geometry_msgs/Transform transform"
    ),
    "sensor_msgs/Imu": (
        "std_msgs/Header header; geometry_msgs/Quaternion orientation; "
        "float64[9] orientation_covariance; geometry_msgs/Vector3 angular_velocity; "
        "float64[9] angular_velocity_covariance; geometry_msgs/Vector3 linear_acceleration; "
        "float64[9] linear_acceleration_covariance"
    ),
    "sensor_msgs/JointState": (
        "std_msgs/Header header; string[] name; float64[] position velocity effort"
    ),
    "sensor_msgs/MagneticField": (
        "std_msgs/Header header; geometry_msgs/Vector3 magnetic_field; "
        "float64[9] magnetic_field_covariance"
    ),
    "sensor_msgs/FluidPressure": "std_msgs/Header header; float64 fluid_pressure variance",
    "sensor_msgs/Temperature": "std_msgs/Header header; float64 temperature variance",
    "sensor_msgs/BatteryState": (
        "std_msgs/Header header; "
        "float32 voltage temperature current charge capacity design_capacity percentage; "
        "uint8 power_supply_status power_supply_health power_supply_technology; "
        "bool present; float32[] cell_voltage cell_temperature; "
        "string location serial_number"
    ),
    "sensor_msgs/NavSatStatus": "int8 status; uint16 service",
    "sensor_msgs/NavSatFix": (
        "std_msgs/Header header; sensor_msgs/NavSatStatus status; "
        "float64 latitude longitude altitude; float64[9] position_covariance; "
        "uint8 position_covariance_type"
    ),
    "sensor_msgs/Joy": "std_msgs/Header header; float32[] axes; int32[] buttons",
    "nav_msgs/Odometry": (
        "std_msgs/Header header; string child_frame_id; "
        "geometry_msgs/PoseWithCovariance pose; geometry_msgs/TwistWithCovariance twist"
    ),
}


def definition(kind: str) -> str:
    """The definition of message `kind` (`std_msgs/msg/String`), with all that it may be made of,
    as MCAP files hold them; nothing if it is not known."""
    own = kind.replace("/msg/", "/")
    if own not in FIELDS:
        return ""
    parts = [f"MSG: {name}\n{_lines(fields)}" for name, fields in FIELDS.items()]
    return "\n===\n".join([_lines(FIELDS[own]), *parts])


def _lines(fields: str) -> str:
    groups = [group.split() for group in fields.split("; ")]
    return "\n".join(f"{kind} {name}" for kind, *names in groups for name in names)
