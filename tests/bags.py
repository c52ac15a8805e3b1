"""ROS bags of images, written by the package rosbags."""

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
RECORDED_NS = 5_000_000_000


def raw(data, encoding, seconds, *, padding=0, big_endian=False):
    """Return the fields of a raw image with data (H, W, ...) of uint8 or uint16."""
    data = data.astype(data.dtype.newbyteorder(">" if big_endian else "<"))
    rows = np.ascontiguousarray(data).view(np.uint8).reshape(len(data), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    height, width = data.shape[:2]
    return IMAGE, seconds, (height, width, encoding, int(big_endian), rows.shape[1], rows.ravel())


def compressed(data, seconds, form="jpeg"):
    """Return the fields of a compressed image."""
    return COMPRESSED, seconds, (form, np.frombuffer(data, np.uint8))


def write_bag(path, topics):
    """Write a bag, of ROS 1 if its name ends in .bag: images by topic, in turn."""
    is_ros1 = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    stamp, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    recorded = RECORDED_NS
    with Writer1(path) if is_ros1 else Writer2(path, version=9) as writer:
        for topic, messages in topics.items():
            kind = messages[0][0] if messages else IMAGE
            connection = writer.add_connection(topic, kind, typestore=store)
            for number, (_, seconds, fields) in enumerate(messages):
                nanoseconds = round(seconds * 1e9)
                of_image = {"stamp": stamp(nanoseconds // 10**9, nanoseconds % 10**9), "frame_id": "camera"}
                sequence = {"seq": number} if is_ros1 else {}
                message = store.types[kind](header(**sequence, **of_image), *fields)
                writer.write(connection, recorded, serialize(message, kind))
                recorded += 10**8
    return path
