"""Image topics of ROS 1 and ROS 2 bags, read by the package rosbags."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.extensions import no_such_file
from omnisight.images.read import UnreadableImage
from omnisight.images.ros_image import IMAGE_TYPES, image_of_message
from omnisight.images.timed_image import TimedImage

BAG_SUFFIXES = (".bag", ".mcap", ".db3")
METADATA_FILE = "metadata.yaml"
# What to do about a bag whose copy or recording was interrupted.
REPAIR = "copy it again, or repair it (rosbag reindex, ros2 bag reindex, mcap recover)"


def is_bag(path: Path, topic: str | None = None) -> bool:
    """Return whether a path is a bag: a file of ROS 1, or a folder or file of ROS 2.

    Raises
    ------
    ValueError
        If a topic is specified, and the path is no bag.
    """
    found = (path / METADATA_FILE).is_file() if path.is_dir() else path.suffix.lower() in BAG_SUFFIXES
    if topic is not None and not found:
        raise ValueError(f"{path}: not a ROS bag, which alone has topics: leave out --topic")
    return found


@dataclass(frozen=True)
class ImageBag:
    """An image topic of a bag.

    Attributes
    ----------
    path
        File or folder of the bag.
    topic
        Name of the topic.
    declared_frames
        Number of messages according to the index of the bag.
    size
        (width, height) of the first image, px.
    """

    path: Path
    topic: str
    declared_frames: int
    size: tuple[int, int]

    @classmethod
    def open(cls, path: Path, topic: str | None = None) -> "ImageBag":
        """Open an image topic.

        Parameters
        ----------
        path
            A .bag file of ROS 1; a folder, .mcap or .db3 file of ROS 2.
        topic
            Name of the topic; it may be left out if the bag has only one with images.

        Raises
        ------
        UnreadableImage
            If the bag cannot be read, or the topic has no image that can be read.
        ValueError
            If the topic is not in the bag or has no images, it is not specified and there are several, or the package
            rosbags is missing.
        """
        with _reader(path) as reader:
            counts = dict[str, int]()
            for connection in reader.connections:
                if connection.msgtype in IMAGE_TYPES and "compressedDepth" not in connection.topic:
                    counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
        name = _choose(path, counts, topic)
        bag = cls(path, name, counts[name], (0, 0))
        reason = f"{path}: {name} has no messages"
        for frame in bag.frames():
            if frame.image is not None:
                return cls(path, name, counts[name], (frame.image.shape[1], frame.image.shape[0]))
            reason = frame.reason
        raise UnreadableImage(reason)

    def frames(self) -> Iterator[TimedImage]:
        """Read the images one at a time, in the order of recording.

        Times are those of the headers, or of the recording where the header has none. An image that cannot be read, or
        whose time is not after that of the one before, has a reason instead.

        Raises
        ------
        UnreadableImage
            If the bag is damaged.
        """
        last = -np.inf
        with _reader(self.path) as reader:
            connections = [connection for connection in reader.connections if connection.topic == self.topic]
            for number, (connection, recorded, data) in enumerate(reader.messages(connections)):
                label = f"{self.path.name}, {self.topic}, message {number}"
                frame = _decode(reader, connection.msgtype, recorded, data, label)
                if not frame.seconds > last:
                    yield TimedImage(frame.seconds, None, f"{label}: its time is not after that of the one before")
                    continue
                last = frame.seconds
                yield frame


def _choose(path: Path, counts: dict[str, int], topic: str | None) -> str:
    """Return the requested topic, or the only one."""
    topics = ", ".join(f"{name} ({count} images)" for name, count in sorted(counts.items()))
    if not counts:
        raise ValueError(f"{path}: has no topic of sensor_msgs/Image or sensor_msgs/CompressedImage")
    used = [name for name, count in counts.items() if count] or list(counts)
    if topic is None and len(used) > 1:
        raise ValueError(f"{path}: has several image topics: {topics}; specify one (--topic)")
    if topic is not None and topic not in counts:
        raise ValueError(f"{path}: has no image topic {topic}; it has {topics}")
    return used[0] if topic is None else topic


def _decode(reader: Any, kind: str, recorded: int, data: bytes, label: str) -> TimedImage:
    """Decode a message."""
    seconds = recorded * 1e-9
    try:
        message = reader.deserialize(data, kind)
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        seconds = stamp if stamp > 0 else seconds
        return TimedImage(seconds, image_of_message(message, label))
    except UnreadableImage as error:
        return TimedImage(seconds, None, str(error))
    except Exception as error:  # rosbags raises errors of many kinds from the bytes of damaged messages
        return TimedImage(seconds, None, f"{label}: damaged message ({error})")


@contextmanager
def _reader(path: Path) -> Generator[Any]:
    """Open a bag."""
    if not path.exists():
        raise UnreadableImage(f"{path}: {no_such_file(path)}")
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ValueError(f"{path}: a ROS bag needs the package rosbags: pip install 'omnisight[ros]'") from None
    try:
        # Bags of ROS 2 before Iron contain no definitions of messages; those of images have never changed.
        reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    except Exception as error:  # damaged files raise errors of many kinds
        raise UnreadableImage(f"{path}: cannot be read as a ROS bag: {_first_line(error)}; {REPAIR}") from None
    try:
        yield reader
    except (UnreadableImage, GeneratorExit):
        raise
    except Exception as error:
        raise UnreadableImage(f"{path}: damaged ROS bag: {_first_line(error)}; {REPAIR}") from None
    finally:
        reader.close()


def _first_line(error: Exception) -> str:
    """Return the first line of a message."""
    return (str(error).splitlines() or [type(error).__name__])[0]
