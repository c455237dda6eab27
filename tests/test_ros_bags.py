"""Bags: two libraries that antway did not write read back what a trace holds."""

from __future__ import annotations

import contextlib
import math
import time
from dataclasses import replace

import numpy as np
import pytest

from antway.errors import BadInput, BadMap, BadParameter, BadScenario
from antway.grid import Grid
from antway.ros2 import convert
from antway.ros2.convert import read_odometry, seconds
from common import cases
from sample import sample_trace

AnyReader = pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed (extra: bags)").AnyReader
mcap_reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed (extra: bags)")
bags = pytest.importorskip("antway.ros2.bags")
load_bag_map, load_bag_tracks, save_bag = bags.load_bag_map, bags.load_bag_tracks, bags.save_bag


def check_against(trace, messages, counts, start):
    """Counts and values of a bag's messages by topic, as some reader gives them, are those of the trace."""
    plans = sum(one.path is not None for _, one in trace.decisions)
    expected = {"/map": 1, "/odom": len(trace) + 1, "/obstacles": len(trace) + 1, "/plan": plans, "/cmd_vel": len(trace)}
    assert counts == expected and {topic: len(list_) for topic, list_ in messages.items()} == expected
    grid = trace.task.grid
    (chart,) = messages["/map"]
    assert (chart.info.width, chart.info.height) == grid.shape[::-1]
    assert (np.asarray(chart.data).reshape(grid.shape) == 100 * grid.blocked).all()
    for i, message in enumerate(messages["/odom"]):
        t, xy, velocity, heading, turn_rate = read_odometry(message)
        assert turn_rate == trace.turn_rate[i]
        assert abs(t - start - trace.t[i]) < 2e-9 and xy == tuple(trace.xy[i])
        np.testing.assert_allclose(velocity, trace.velocity[i], rtol=0, atol=1e-14)
        assert math.isclose(heading, trace.heading[i], rel_tol=1e-14, abs_tol=1e-15)
    for i, message in enumerate(messages["/cmd_vel"]):
        assert abs(seconds(message.header.stamp) - start - trace.t[i]) < 2e-9
        speed = math.hypot(message.twist.linear.x, message.twist.linear.y)
        assert math.isclose(speed, math.hypot(*trace.command[i]), rel_tol=1e-14, abs_tol=1e-15)
    paths = [one.path for _, one in trace.decisions if one.path is not None]
    for message, path in zip(messages["/plan"], paths, strict=True):
        assert [(p.pose.position.x, p.pose.position.y) for p in message.poses] == [tuple(p) for p in path.xy.tolist()]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_rosbags_reads_what_was_written(tmp_path, storage):
    """rosbags' own reader finds every message of a trace, with its values, in either storage."""
    trace, start = sample_trace(steps=60), 1_700_000_000.0
    trace = replace(trace, turn_rate=np.random.default_rng(5).uniform(-2.0, 2.0, len(trace.t)))
    counts = save_bag(trace, tmp_path / "bag", storage=storage, start=start)
    messages = {topic: [] for topic in counts}
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == sum(counts.values())
        for line, _, data in reader.messages():
            messages[line.topic].append(reader.deserialize(data, line.msgtype))
    # at this date, float64 seconds resolve 2.4e-7 s, so times are compared after the bag's start was taken off
    first = messages["/odom"][0].header.stamp.sec
    for topic in ("/odom", "/cmd_vel"):
        for message in messages[topic]:
            message.header.stamp.sec -= first
            message.header.stamp.nanosec = round(message.header.stamp.nanosec, -6)
    check_against(trace, messages, counts, 0.0)


def test_a_start_that_no_stamp_holds_is_refused_before_a_folder_is_there(tmp_path) -> None:
    """Stamps are of 31 bits of seconds, and the last one of the trace has to be, too."""
    trace = sample_trace(steps=20)
    for start in (3e9, 2.0**31, 2.0**31 - float(trace.t[-1])):
        with pytest.raises(BadParameter, match="start = "):
            save_bag(trace, tmp_path / "bag", start=start)
        assert not (tmp_path / "bag").exists()
    assert save_bag(trace, tmp_path / "bag", start=2.0**31 - 1.0 - float(trace.t[-1]))["/odom"] == len(trace) + 1


@pytest.mark.parametrize("place", ["file/bag", "no\0name", None])
def test_where_no_bag_can_be_written_is_told(tmp_path, place: str | None) -> None:
    """It was an error of the system, as it was for what is no trace."""
    (tmp_path / "file").touch()
    with pytest.raises(BadParameter, match=r"bag = .*path"):
        save_bag(sample_trace(steps=2), place and f"{tmp_path}/{place}")
    with pytest.raises(BadParameter, match="trace = None"):
        save_bag(None, tmp_path / "bag")
    assert not (tmp_path / "bag").exists()


def test_of_many_maps_only_the_last_is_kept(tmp_path) -> None:
    """A bag of slam_toolbox holds a map each 5 s: all of them together used to be too large for the memory of the reader."""
    grids = [Grid(np.zeros((3, 4 + k), bool), 0.5) for k in range(3)]
    with bags.Writer(tmp_path / "bag", version=9, storage_plugin=bags.STORES["mcap"]) as writer:
        line = writer.add_connection("/map", "nav_msgs/msg/OccupancyGrid", typestore=bags._TYPES)
        for k, grid in enumerate(grids):
            message = convert.grid_message(grid, bags.make)
            writer.write(line, k, bags._TYPES.serialize_cdr(message, "nav_msgs/msg/OccupancyGrid"))
    assert bags.read_topic(str(tmp_path / "bag"), "/map", None) == [grids[-1]]
    assert load_bag_map(tmp_path / "bag") == grids[-1]


def test_mcap_ros2_support_reads_what_was_written(tmp_path):
    """mcap-ros2-support finds every message of a trace, with its values."""
    trace = sample_trace(steps=60)
    counts = save_bag(trace, tmp_path / "bag")
    messages = {topic: [] for topic in counts}
    (file,) = (tmp_path / "bag").glob("*.mcap")
    for one in mcap_reader.read_ros2_messages(str(file)):
        messages[one.channel.topic].append(one.ros_msg)
    check_against(trace, messages, counts, 0.0)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_maps_and_tracks_come_back(tmp_path, storage):
    """The map and the sensed tracks read from a bag are those of the trace."""
    trace = sample_trace(steps=40, obstacles=5)
    save_bag(trace, tmp_path / "bag", storage=storage)
    assert load_bag_map(tmp_path / "bag") == trace.task.grid
    scans = load_bag_tracks(tmp_path / "bag")
    assert len(scans) == len(trace.t)
    for i, (t, tracks) in enumerate(scans):
        seen = trace.sensed[i]
        assert abs(t - trace.t[i]) < 2e-9 and (tracks.id == trace.timeline.id[seen]).all()
        np.testing.assert_array_equal(tracks.xy, trace.timeline.at(trace.t[i])[0][seen])
        np.testing.assert_array_equal(tracks.radius, trace.timeline.radius[seen])


def test_a_bag_that_promises_more_than_it_holds_is_refused(tmp_path):
    """Metadata that counts more messages than are there, a topic that is not there, and a folder that is no bag are refused."""
    save_bag(sample_trace(steps=10), tmp_path / "bag", storage="sqlite3")
    with pytest.raises(BadMap, match=r"/chart.*the bag has"):
        load_bag_map(tmp_path / "bag", "/chart")
    with pytest.raises(BadScenario, match="/map"):
        load_bag_tracks(tmp_path / "bag", "/map")
    about = tmp_path / "bag" / "metadata.yaml"
    about.write_text(about.read_text().replace("message_count: 11", "message_count: 12"))
    with pytest.raises(BadScenario, match="the 12 of the bag's metadata"):
        load_bag_tracks(tmp_path / "bag")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadMap, match="a readable bag"):
        load_bag_map(tmp_path / "empty")
    with pytest.raises(BadScenario, match="does not exist yet"):
        save_bag(sample_trace(steps=10), tmp_path / "bag")
    with pytest.raises(BadParameter, match="mcap, sqlite3"):
        save_bag(sample_trace(steps=10), tmp_path / "other", storage="db4")


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_spoilt_bags_are_refused_or_read(tmp_path, storage):
    """D9: whatever bytes are changed, cut or swapped, it ends in a value or in a `BadInput`, lengths beyond all memory too."""
    save_bag(sample_trace(steps=4), tmp_path / "bag", storage=storage)
    file = next(one for one in (tmp_path / "bag").iterdir() if one.suffix in (".mcap", ".db3"))
    sound, rng, refused = file.read_bytes(), np.random.default_rng(1), 0
    for _ in range(cases(60, 6000)):
        data = bytearray(sound)
        for place in rng.integers(len(data), size=rng.integers(1, 30)):
            data[place] = rng.choice([0, 255, rng.integers(256)])
        file.write_bytes(data[: rng.integers(len(data))] if rng.random() < 0.2 else data)
        for topic, radius in (("/map", None), ("/obstacles", 0.3)):
            try:
                bags.read_topic(str(tmp_path / "bag"), topic, radius)  # a process for each would take a second a case
            except BadInput:
                refused += 1
    assert refused > 10
    about = (tmp_path / "bag" / "metadata.yaml").read_bytes()
    file.write_bytes(sound)
    for _ in range(cases(30, 3000)):
        data = bytearray(about)
        for place in rng.integers(len(data), size=rng.integers(1, 10)):
            data[place] = rng.integers(256)
        (tmp_path / "bag" / "metadata.yaml").write_bytes(data)
        with contextlib.suppress(BadInput):
            bags.check_bag(str(tmp_path / "bag"), BadMap)
            bags.read_topic(str(tmp_path / "bag"), "/map", None)


@pytest.mark.parametrize(
    "bomb",
    [
        "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 40)),
        "b0: &b0 {x: 1}\n" + "".join(f"b{i}: &b{i}\n  <<: [{', '.join([f'*b{i - 1}'] * 50)}]\n" for i in range(1, 7)),
        "deep: " + "[" * 50_000 + "\n",
        "  " * 300 + "\n".join("  " * i + f"k{i}:" for i in range(300)) + " 1\n",
        "long: [" + "x, " * 60_000 + "]\n",
        "qos: '" + "[" * 5000 + "'\n",
    ],
    ids=["lists", "merges", "deep", "indented", "long", "within a text"],
)
def test_bombs_in_metadata_are_refused_before_they_go_off(tmp_path, bomb):
    """References to references, which took minutes, and depth, which took a square of itself: refused at once, typed."""
    save_bag(sample_trace(steps=4), tmp_path / "bag", storage="sqlite3")
    about = tmp_path / "bag" / "metadata.yaml"
    about.write_text(bomb + about.read_text())
    started = time.process_time()
    with pytest.raises(BadInput):
        load_bag_map(tmp_path / "bag")
    assert time.process_time() - started < 5.0


def zeros(compressor, gibibytes=1.25):
    """What `compressor` makes of so many GiB of zeros."""
    block = bytes(2**24)
    return b"".join(compressor.compress(block) for _ in range(int(gibibytes * 64))) + compressor.flush()


def mcap_bomb(folder, name):
    """An mcap whose one compressed chunk of noise is replaced by one of zeros, which says nothing of its size."""
    writer_of = pytest.importorskip("mcap.writer")
    path = folder / "bomb.mcap"
    with path.open("wb") as file:
        writer = writer_of.Writer(file, compression=writer_of.CompressionType[name.upper()], chunk_size=2**24)
        writer.start("ros2")
        schema = writer.register_schema("nav_msgs/msg/OccupancyGrid", "ros2msg", b"")
        channel = writer.register_channel("/map", "cdr", schema)
        noise = np.random.default_rng(0).bytes(2**23)
        writer.add_message(channel, log_time=0, data=noise, publish_time=0)
        writer.finish()
    data = bytearray(path.read_bytes())
    begin = data.index({"zstd": b"\x28\xb5\x2f\xfd", "lz4": b"\x04\x22\x4d\x18"}[name])
    size = int.from_bytes(data[begin - 8 : begin], "little")
    if name == "zstd":
        from backports.zstd import ZstdCompressor

        small = zeros(ZstdCompressor())
        small += b"\x50\x2a\x4d\x18" + (size - len(small) - 8).to_bytes(4, "little")  # a frame to be skipped fills the rest
    else:
        from lz4.frame import LZ4FrameCompressor

        compressor = LZ4FrameCompressor(block_size=7)
        small = compressor.begin() + zeros(compressor)
    assert len(small) <= size
    data[begin : begin + len(small)] = small
    path.write_bytes(data)
    return path


def sqlite_bomb(folder, mode):
    """A bag of sqlite3 whose messages, or whose file, are compressed zeros."""
    import sqlite3

    from backports.zstd import ZstdCompressor

    save_bag(sample_trace(steps=4), folder / "bag", storage="sqlite3")
    about, (file,) = folder / "bag" / "metadata.yaml", (folder / "bag").glob("*.db3")
    text = about.read_text().replace("compression_format: ''", "compression_format: zstd")
    about.write_text(text.replace("compression_mode: ''", f"compression_mode: {mode}"))
    if mode == "message":
        with contextlib.closing(sqlite3.connect(file)) as base, base:
            base.execute("UPDATE messages SET data = ?", (zeros(ZstdCompressor()),))
    else:
        file.write_bytes(zeros(ZstdCompressor()))
    return folder / "bag"


@pytest.mark.parametrize("kind", ["zstd", "lz4", "message", "file"])
def test_compressed_bombs_cost_one_process(tmp_path, kind):
    """D4: what unpacks to 1.25 GiB, in a chunk, a message or a file, is refused by a process that ends, and not by this one."""
    import resource

    path = mcap_bomb(tmp_path, kind) if kind in ("zstd", "lz4") else sqlite_bomb(tmp_path, kind)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(BadInput, match=r"unpacks to more|resize buffer|File too large"):
        load_bag_map(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**15  # KiB
