"""Bags of ROS 2: written by the reference library and read by ours, and the other way; what is wrong in them."""

from __future__ import annotations

import sqlite3
import sys
from contextlib import closing
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import continuum_grasp as cg
from continuum_grasp.addons.identification import IdentifyScene, commission, read_data, replay
from continuum_grasp.base import InputError
from continuum_grasp.cli import app
from continuum_grasp.results import Result
from continuum_grasp.scene import DataTable
from tests.identification.test_comparison import LENGTH, ROD, on_arc

make_reader = pytest.importorskip("mcap.reader", reason="bags; in the extra 'test'").make_reader
DecoderFactory = pytest.importorskip("mcap_ros2.decoder", reason="bags; in the extra 'test'").DecoderFactory

STEADY = str(Path(__file__).parents[2] / "configs/mpc/steady_tip.yaml")
PARTS = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
"""
POINT = "std_msgs/Header header\ngeometry_msgs/Point position\nstring label\n" + PARTS
JOINTS = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat32 load\n" + PARTS
BARE = "float64 data\n"
BEGIN = 1_700_000_000_123_456_789  # ns


def header(ns):
    return {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": "camera"}


def written(path, messages, *, in_turn=False):
    """A bag of the reference library: topic, definition, stamp after the beginning [ns], and fields of each message.

    Messages are logged at their stamps, or in turn, a microsecond apart.
    """
    from mcap_ros2.writer import Writer

    with open(path, "wb") as stream, Writer(stream) as writer:
        schemas = {}
        for k, (topic, definition, ns, fields) in enumerate(messages):
            schema = schemas.get(definition)
            if schema is None:
                schema = schemas[definition] = writer.register_msgdef(f"tests/msg/Kind{len(schemas)}", definition)
            headed = {} if definition == BARE else {"header": header(BEGIN + ns)}
            writer.write_message(topic, schema, headed | fields, log_time=BEGIN + (1000 * k if in_turn else ns))
    return path


def tips(numbers, ns=10_000_000, topic="/finger/tip"):
    return [
        (topic, POINT, k * ns, {"position": {"x": x, "y": -2.0 * x, "z": 0.0}, "label": "ok"})
        for k, x in enumerate(numbers)
    ]


def joints(numbers, stamps, topic="/joint_states"):
    return [
        (topic, JOINTS, ns, {"name": ["a", "b"], "position": [x, x + 1.0], "load": 0.5})
        for ns, x in zip(stamps, numbers, strict=True)
    ]


NUMBERS = np.random.default_rng(0).standard_normal(20)


def test_bags_of_the_reference_library_are_read_to_the_bit(tmp_path):
    bag = written(
        tmp_path / "a.mcap", tips(NUMBERS.tolist()) + joints(NUMBERS.tolist(), range(0, 200_000_000, 10_000_000))
    )
    columns = ["/finger/tip", "/finger/tip.position.x", "/finger/tip.position.y [mm]", "/joint_states.position[1]"]
    table = DataTable.read(bag, columns=columns, leader="/finger/tip")
    assert np.array_equal(table.numbers("/finger/tip.position.x"), NUMBERS)
    assert np.array_equal(table.numbers("/joint_states.position[1]"), NUMBERS + 1.0)
    assert np.array_equal(table.numbers("/finger/tip"), np.arange(20) * 10_000_000 / 1e9)
    assert table.in_si("/finger/tip.position.y", "m") == pytest.approx(-2e-3 * NUMBERS, rel=1e-15)
    assert table.chosen("/joint_states.position[1]", [repr(float(NUMBERS[3] + 1.0))]).lines == (4,)


def test_our_bags_are_read_by_the_reference_library_to_the_bit(tmp_path):
    t = 0.01 * np.arange(20)
    gaps = np.where(np.arange(20) % 3 == 0, np.nan, NUMBERS)
    columns = {"tip_x [m]": NUMBERS, "angle_0.09 [rad]": gaps, "angle 0 09": NUMBERS + 1.0, "health": ["ok"] * 20}
    (tmp_path / "b.mcap").write_bytes(
        DataTable.bag({"/measured": (t, columns), "/other": (t[:2], {"x": t[:2]})}, BEGIN)
    )
    with open(tmp_path / "b.mcap", "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        messages = [*reader.iter_decoded_messages(log_time_order=False)]
    logged = [message.message.log_time for message in messages]
    own = [message.decoded_message for message in messages if message.channel.topic == "/measured"]
    assert len(messages) == 22
    assert logged == sorted(logged)
    assert [message.tip_x for message in own] == NUMBERS.tolist()
    assert np.array_equal([message.angle_0_09 for message in own], gaps, equal_nan=True)
    assert [message.angle_0_09_2 for message in own] == (NUMBERS + 1.0).tolist()
    assert {message.health for message in own} == {"ok"}
    stamps = [message.header.stamp for message in own]
    assert [stamp.sec * 10**9 + stamp.nanosec for stamp in stamps] == [BEGIN + 10_000_000 * k for k in range(20)]
    read = DataTable.read(tmp_path / "b.mcap", columns=["tip_x", "angle_0.09"])
    assert np.array_equal(read.numbers("tip_x"), NUMBERS)
    assert np.array_equal(read.numbers("angle_0.09", gaps=True), gaps, equal_nan=True)


def test_the_last_value_counts_up_to_its_age_and_nothing_is_interpolated(tmp_path):
    """Joints at 0, 25 and 30 ms, of which the first is 20 ms old at the third tip."""
    bag = written(tmp_path / "a.mcap", tips([0.0] * 6) + joints([1.0, 2.0, 3.0], [0, 25_000_000, 30_000_000]))
    asked = {"columns": ["/joint_states.position[0]"], "leader": "/finger/tip.position.x"}

    def held(**age):
        return DataTable.read(bag, **asked, **age).numbers("/joint_states.position[0]", gaps=True)

    nan = np.nan
    assert np.array_equal(held(max_age=0.02), [1.0, 1.0, 1.0, 3.0, 3.0, 3.0])
    assert np.array_equal(held(max_age=0.019), [1.0, 1.0, nan, 3.0, 3.0, nan], equal_nan=True)
    assert np.array_equal(held(), [1.0, nan, nan, 3.0, nan, nan], equal_nan=True)
    together = DataTable.read(bag, columns=["load", "/finger/tip.position.y"])
    assert together.numbers("t") == pytest.approx([0.0, 0.01, 0.02, 0.025, 0.03, 0.04, 0.05], abs=1e-15)
    assert np.isfinite(together.numbers("load", gaps=True)).tolist() == [True, False, False, True, True, False, False]


def test_stamps_are_of_headers_or_of_the_recording(tmp_path):
    bag = written(tmp_path / "a.mcap", [*tips([1.0, 2.0]), ("/bare", BARE, 0, {"data": 3.0})], in_turn=True)
    asked = {"columns": ["/finger/tip.position.x"], "leader": "/finger/tip"}
    assert DataTable.read(bag, **asked).numbers("/finger/tip").tolist() == [0.0, 0.01]
    assert DataTable.read(bag, **asked, stamps="log").numbers("/finger/tip").tolist() == [0.0, 1e-6]
    assert DataTable.read(bag, columns=["data", "/finger/tip.label"], stamps="log").numbers("t").tolist() == [
        0,
        1e-6,
        2e-6,
    ]
    with pytest.raises(InputError, match="has no header with a stamp: set stamps: log"):
        DataTable.read(bag, columns=["data"])


FAULTS = [
    (
        ["/finger/tp.position.x"],
        r"no topic '/finger/tp'; did you mean '/finger/tip'\? \(the bag has /finger/tip, /joint",
    ),
    (["/finger/tip.position.w"], r"has no field 'position.w'.*it has header.stamp.sec, .*position.x, position.y"),
    (["/finger/tip.position"], "position is no number: name one of position.x, position.y, position.z"),
    (["/joint_states.position"], r"is a list: name an entry of it, such as position\[0\]"),
    (["/joint_states.position[7]"], r"no message has /joint_states.position\[7\]"),
    (["/finger/tip.position.x[0]"], "position.x is no list"),
    (["/finger/tip..x"], "expected /topic.field"),
]


@pytest.mark.parametrize(("columns", "words"), FAULTS)
def test_what_a_bag_does_not_have_is_an_error_that_lists_what_it_has(tmp_path, columns, words):
    bag = written(tmp_path / "a.mcap", tips([1.0]) + joints([1.0], [0]))
    with pytest.raises(InputError, match=words) as caught:
        DataTable.read(bag, columns=columns, leader=columns[0])
    assert caught.value.file == str(bag)


def test_a_text_is_no_number_and_a_field_of_two_topics_needs_its_topic(tmp_path):
    bag = written(tmp_path / "a.mcap", tips([1.0, 2.0]))
    table = DataTable.read(bag, columns=["/finger/tip.label"], leader="/finger/tip")
    with pytest.raises(InputError, match=r"expected a number, got 'ok' \(message 1\)"):
        table.numbers("/finger/tip.label")
    both = written(tmp_path / "b.mcap", joints([1.0], [0], "/a") + joints([1.0], [0], "/b"))
    with pytest.raises(InputError, match=r"2 topics have a field load: write /a.load or /b.load"):
        DataTable.read(both, columns=["load"])
    apart = written(tmp_path / "c.mcap", tips([1.0]) + joints([1.0], [1]))
    with pytest.raises(InputError, match=r"no message of /joint_states goes with one of /finger/tip.*state max_age"):
        DataTable.read(apart, columns=["/joint_states.load"], leader="/finger/tip")


def test_other_topics_of_a_bag_may_be_what_they_like(tmp_path):
    """A topic whose messages the library cannot decode, and one that is not of ROS 2."""
    from mcap.writer import Writer

    with open(tmp_path / "a.mcap", "wb") as stream:
        writer = Writer(stream)
        writer.start()
        for topic, encoding, kind, text in (
            ("/wide", "cdr", "ros2msg", "wstring text\n"),
            ("/json", "json", "jsonschema", "{}"),
            ("/data", "cdr", "ros2msg", BARE),
        ):
            schema = writer.register_schema(f"tests/msg/{topic[1:].title()}", kind, text.encode())
            channel = writer.register_channel(topic, encoding, schema)
            writer.add_message(channel, 7, b"\0\1\0\0" + np.float64(3.5).tobytes(), 7)
        writer.finish()
    assert DataTable.read(tmp_path / "a.mcap", columns=["data"], stamps="log").numbers("data").tolist() == [3.5]
    faults = {"/wide.text": "cannot decode a message: wstring", "/json.x": "no messages of ROS 2.*but json, jsonschema"}
    for column, words in {**faults, "/data": "expected a field of the topic"}.items():
        with pytest.raises(InputError, match=words):
            DataTable.read(tmp_path / "a.mcap", columns=[column], stamps="log")


def test_a_file_that_is_cut_off_says_what_was_read(tmp_path):
    bag = written(tmp_path / "a.mcap", tips(NUMBERS.tolist()))
    content = bag.read_bytes()
    bag.write_bytes(content[: len(content) - 40])
    with pytest.raises(InputError, match=r"cut off or damaged .*before the fault are 20 of /finger/tip, in 0.19 s"):
        DataTable.read(bag)
    bag.write_bytes(content[:60])
    with pytest.raises(InputError, match="no message can be read"):
        DataTable.read(bag)
    bag.write_bytes(b"t,x\n0,1\n")
    with pytest.raises(InputError, match="is no MCAP or SQLite file"):
        DataTable.read(bag)
    text = tmp_path / "points.csv"
    text.write_text("t,x\n0,1\n")
    with pytest.raises(InputError, match=r"missing\.mcap: no such file"):
        DataTable.read(tmp_path / "missing.mcap", stamps="log")
    with pytest.raises(InputError, match="max_age: is for bags"):
        DataTable.read(text, max_age=0.1)


def in_sqlite(bag, path, *, defined=True):
    """The messages of an MCAP bag in a file as rosbag2 writes them by sqlite3 (its schema 4; 3 without definitions)."""
    with open(bag, "rb") as stream, closing(sqlite3.connect(path)) as data, data:
        data.execute(
            "CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format, offered_qos_profiles)"
        )
        data.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
        if defined:
            data.execute(
                "CREATE TABLE message_definitions (id INTEGER PRIMARY KEY, topic_type, encoding, "
                "encoded_message_definition, type_description_hash)"
            )
        known = set()
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.id not in known:
                known.add(channel.id)
                data.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (channel.id, channel.topic, schema.name))
                if defined:
                    row = (schema.name, schema.encoding, schema.data.decode())
                    data.execute("INSERT INTO message_definitions VALUES (NULL, ?, ?, ?, '')", row)
            row = (channel.id, message.log_time, message.data)
            data.execute("INSERT INTO messages VALUES (NULL, ?, ?, ?)", row)
    return path


def test_a_bag_in_sqlite_is_read_as_the_same_in_mcap(tmp_path):
    messages = sorted(tips(NUMBERS) + joints(NUMBERS, [10_000_000 * k for k in range(20)]), key=lambda each: each[2])
    bag = written(tmp_path / "a.mcap", messages)
    other = in_sqlite(bag, tmp_path / "a.db3")
    for options in ({}, {"columns": ["/finger/tip.position.x"], "leader": "/joint_states", "max_age": 0.1}):
        one, same = (DataTable.read(file, **options) for file in (bag, other))
        assert (one.headings, one.units, one.rows) == (same.headings, same.units, same.rows)
    with pytest.raises(InputError, match="no topic '/finger/tap'"):
        DataTable.read(other, columns=["/finger/tap.position.x"])
    with pytest.raises(InputError, match=r"ros2 bag convert -i .* storage_id: mcap"):
        DataTable.read(in_sqlite(bag, tmp_path / "old.db3", defined=False))
    folder = tmp_path / "recorded"
    folder.mkdir()
    (folder / "metadata.yaml").touch()
    with pytest.raises(
        InputError, match=r"expected a bag with files \.mcap or \.db3, got a folder with metadata\.yaml"
    ):
        DataTable.read(folder)
    (folder / "recorded_0.db3").write_bytes(other.read_bytes())
    assert DataTable.read(folder).rows == DataTable.read(bag).rows
    text = tmp_path / "text.db3"
    text.write_text("t [s],x [m]\n0,1\n")
    with pytest.raises(InputError, match="is no MCAP or SQLite file"):
        DataTable.read(text)
    torn = tmp_path / "torn.db3"
    torn.write_bytes(other.read_bytes()[:9000])
    with pytest.raises(InputError, match="cut off or damaged"):
        DataTable.read(torn)


def test_a_recording_in_several_files_is_one_bag(tmp_path):
    """As ``ros2 bag record --max-bag-duration`` splits it; the tenth file comes behind the second one."""
    folder = tmp_path / "recorded"
    folder.mkdir()
    (folder / "metadata.yaml").touch()
    messages = tips(NUMBERS.tolist()) + joints(NUMBERS.tolist(), range(0, 200_000_000, 10_000_000))
    for number, first in ((0, 0), (2, 50_000_000), (10, 120_000_000)):
        part = [each for each in messages if first <= each[2] < {0: 50, 2: 120, 10: 999}[number] * 1_000_000]
        written(folder / f"recorded_{number}.mcap", part)
    whole = written(tmp_path / "whole.mcap", messages)
    asked = {"columns": ["/joint_states.position[1]"], "leader": "/finger/tip.position.x"}
    for options in ({}, asked):
        one, parts = DataTable.read(whole, **options), DataTable.read(folder, **options)
        assert (one.headings, one.rows, one.notes) == (parts.headings, parts.rows, parts.notes)
    in_sqlite(folder / "recorded_2.mcap", folder / "recorded_2.db3")
    (folder / "recorded_2.mcap").unlink()
    assert DataTable.read(folder, **asked).rows == DataTable.read(whole, **asked).rows


@pytest.mark.parametrize("named", [None, "take", "take_*.mcap"])
def test_folders_of_bags_are_data_sets(tmp_path, named):
    """Two poses, in one file each: together one set by the folder, and a set each by their names."""
    folder = tmp_path / "take"
    folder.mkdir()
    (folder / "metadata.yaml").touch()
    for k, moment in enumerate((0.01, 0.02)):
        x, y = on_arc(moment, LENGTH)
        tip = {"position": {"x": x, "y": y, "z": 0.0}, "label": ""}
        stamp = k * 1_000_000
        moved = ("/bench", JOINTS, stamp, {"name": [], "position": [moment], "load": 0.0})
        written(folder / f"take_{k}.mcap", [moved, ("/camera", POINT, stamp, tip)])
    data = {
        "kind": "static",
        "file": named,
        "conditions": [{"name": "tip_moment", "column": "/bench.position[0]"}],
        "measured": [{"quantity": axis, "column": f"/camera.position.{axis}"} for axis in "xy"],
    }
    sets = read_data(IdentifyScene(**ROD, data=[data]), [folder])
    assert [poses.rows for poses in sets] == ([1, 1] if named == "take_*.mcap" else [2])
    assert np.concatenate([poses.conditions["tip_moment"] for poses in sets]).tolist() == [0.01, 0.02]
    if named is not None:
        beside = read_data(IdentifyScene(**ROD, data=[data]), beside=folder if "*" in named else tmp_path)
        assert [poses.rows for poses in beside] == [poses.rows for poses in sets]


@pytest.mark.parametrize("leader", ["/finger/tip.position.x", None])
def test_stamps_out_of_order_are_sorted_and_reported(tmp_path, leader):
    """Each message carries its stamp, so the sorted bag is the one whose messages were never late."""
    messages = tips(NUMBERS.tolist()) + joints(NUMBERS.tolist(), range(0, 200_000_000, 10_000_000))
    late = messages.copy()
    late[4], late[5], late[30], late[34] = messages[5], messages[4], messages[34], messages[30]
    asked = {"columns": ["/finger/tip.position.x", "/joint_states.load"], "leader": leader}
    plain, mended = (
        DataTable.read(written(tmp_path / f"{len(each)}.mcap", each, in_turn=True), **asked)
        for each in (messages, late)
    )
    assert plain.rows == mended.rows
    assert plain.notes == ()
    assert [note.partition(": ")[2] for note in mended.notes] == [
        "/finger/tip: 1 of 20 messages come after later ones: sorted by their instants",
        "/joint_states: 4 of 20 messages come after later ones: sorted by their instants",
    ]
    again = written(tmp_path / "again.mcap", messages[:20] + messages[:20], in_turn=True)
    with pytest.raises(InputError, match=r"topic /finger/tip: a second run begins at number 21 of 40 messages"):
        DataTable.read(again, **{**asked, "columns": asked["columns"][:1]})


TRAJECTORY = "std_msgs/Header header\nstring[] joint_names\nPoint[] points\n" + PARTS
TRAJECTORY += "=" * 80 + "\nMSG: tests/Point\nfloat64[] positions\nfloat64[] effort\n"
DYNAMIC = "std_msgs/Header header\nstring[] joint_names\nInterface[] interface_values\n" + PARTS
DYNAMIC += "=" * 80 + "\nMSG: tests/Interface\nstring[] interface_names\nfloat64[] values\n"
FRAMES = "std_msgs/Header header\nFrame[] transforms\n" + PARTS
FRAMES += "=" * 80 + "\nMSG: tests/Frame\nstring child_frame_id\ngeometry_msgs/Point translation\n"


def state(names, **fields):
    return {"name": names, "position": [], "load": 0.0, **fields}


def dynamic(joints, interfaces):
    values = [
        {"interface_names": [*interfaces], "values": [10.0 * "ab".index(j) + "pv".index(i) for i in interfaces]}
        for j in joints
    ]
    return {"joint_names": [*joints], "interface_values": values}


def frames(names):
    moved = {"y": 0.0, "z": 0.0}
    return {"transforms": [{"child_frame_id": n, "translation": {"x": float("abc".index(n)), **moved}} for n in names]}


NAMED = {
    "joints change their order": (
        JOINTS,
        "position[1]",
        [state(["a", "b"], position=[1, 2]), state(["b", "a"], position=[2, 1])],
        [2, 2],
    ),
    "a joint by its name": (
        JOINTS,
        "position[b]",
        [state(["a", "b"], position=[1, 2]), state(["b", "a"], position=[2, 1])],
        [2, 2],
    ),
    "a joint is missing": (
        JOINTS,
        "position[0]",
        [state(["a", "b"], position=[1, 2]), state(["b"], position=[2]), state(["c", "a"], position=[3, 1])],
        [1, None, 1],
    ),
    "more joints come": (
        JOINTS,
        "position[1]",
        [state(["a", "b"], position=[1, 2]), state(["c", "a", "b"], position=[3, 1, 2])],
        [2, 2],
    ),
    "readings are missing": (JOINTS, "position[0]", [state(["a"]), state(["a", "b"], position=[1, 2])], [None, 1]),
    "no names": (JOINTS, "position[1]", [state([], position=[1, 2]), state([], position=[3, 4])], [2, 4]),
    "names are alike": (
        JOINTS,
        "position[1]",
        [state(["", ""], position=[1, 2]), state(["", ""], position=[3, 4])],
        [2, 4],
    ),
    "a trajectory": (
        TRAJECTORY,
        "points[0].positions[0]",
        [
            {"joint_names": [*n], "points": [{"positions": p, "effort": []}]}
            for n, p in (("ab", [1, 2]), ("ba", [2, 1]))
        ],
        [1, 1],
    ),
    "joints and interfaces": (
        DYNAMIC,
        "interface_values[1].values[0]",
        [dynamic("ab", "pv"), dynamic("ba", "pv"), dynamic("ba", "vp")],
        [10, 10, 10],
    ),
    "an interface by its name": (
        DYNAMIC,
        "interface_values[b].values[v]",
        [dynamic("ab", "pv"), dynamic("ba", "vp")],
        [11, 11],
    ),
    "frames": (FRAMES, "transforms[0].translation.x", [frames("ab"), frames("ba"), frames("b")], [0, 0, None]),
    "a frame by its name": (FRAMES, "transforms[c].translation.x", [frames("ab"), frames("ca")], [None, 2]),
}


@pytest.mark.parametrize("case", NAMED)
def test_names_are_the_keys_of_the_entries_of_lists(tmp_path, case):
    definition, field, messages, expected = NAMED[case]
    bag = written(tmp_path / "a.mcap", [("/t", definition, 1000 * k, fields) for k, fields in enumerate(messages)])
    for file in (bag, in_sqlite(bag, tmp_path / "a.db3")):
        table = DataTable.read(file, columns=[f"/t.{field}"], leader="/t")
        assert [None if np.isnan(v) else v for v in table.numbers(f"/t.{field}", gaps=True)] == expected


WRONG_NAMES = {
    "position[c]": ([state(["a", "b"], position=[1, 2])], r"no message has /t.position\[c\]: no entry has that name"),
    "position[a]": ([state([], position=[1, 2])], "nothing names the entries of position: give a number"),
    "position[0]": ([state(["a", "b"], position=[1])], "2 names and 1 entries of position"),
}


@pytest.mark.parametrize("field", WRONG_NAMES)
def test_names_that_do_not_fit_are_an_error(tmp_path, field):
    messages, words = WRONG_NAMES[field]
    bag = written(tmp_path / "a.mcap", [("/t", JOINTS, 0, fields) for fields in messages])
    with pytest.raises(InputError, match=words):
        DataTable.read(bag, columns=[f"/t.{field}"], leader="/t")


FAULTS = {
    "no topic '/finger/tip' .the bag has none": ("topics", "messages", "message_definitions"),
    "no topic '/finger/tip' .the bag has /joint_states": "UPDATE topics SET name = NULL WHERE name = '/finger/tip'",
    "no bag of ROS 2: its table messages has no data": "ALTER TABLE messages RENAME COLUMN data TO body",
    "no bag of ROS 2: its table topics has no id, name": "ALTER TABLE topics RENAME TO a; CREATE TABLE topics (x)",
    "but cdr, no schema": "UPDATE message_definitions SET encoded_message_definition = NULL",
    "has no time of recording, but None": "UPDATE messages SET timestamp = NULL",
    r"damaged .OperationalError: Could not decode [^\n]*recover`$": "UPDATE topics SET type = CAST(x'0aff' AS TEXT)",
}


@pytest.mark.parametrize("words", FAULTS)
def test_tables_of_another_shape_are_an_error_of_one_line(tmp_path, words):
    """Empty recordings, tables of other programs, values that are missing: none of these is a file that is damaged."""
    bag = written(tmp_path / "a.mcap", tips([1.0, 2.0]) + joints([1.0], [0]))
    fault = FAULTS[words]
    with closing(sqlite3.connect(in_sqlite(bag, tmp_path / "a.db3"))) as data:
        data.executescript(fault if isinstance(fault, str) else ";".join(f"DELETE FROM {each}" for each in fault))
    with pytest.raises(InputError, match=words):
        DataTable.read(tmp_path / "a.db3", columns=["/finger/tip.position.x"], stamps="log")


def test_names_and_definitions_may_be_blobs(tmp_path):
    bag = written(tmp_path / "a.mcap", tips([1.0, 2.0]))
    with closing(sqlite3.connect(in_sqlite(bag, tmp_path / "a.db3"))) as data, data:
        data.execute("UPDATE topics SET name = CAST(name AS BLOB)")
        column = "encoded_message_definition"
        data.execute(f"UPDATE message_definitions SET {column} = CAST({column} AS BLOB)")
    assert DataTable.read(tmp_path / "a.db3").rows == DataTable.read(bag).rows


def test_a_recording_that_was_broken_off_has_its_last_messages_in_the_file_beside_it(tmp_path):
    """With the preset ``resilient`` of rosbag2, messages are in a write-ahead file until that is merged."""
    bag = in_sqlite(written(tmp_path / "a.mcap", tips([1.0, 2.0])), tmp_path / "recording.db3")
    with closing(sqlite3.connect(bag)) as data:
        data.execute("PRAGMA journal_mode = WAL")
        data.execute("INSERT INTO messages SELECT NULL, topic_id, timestamp + 1000000000, data FROM messages")
        data.commit()
        for each in (bag, tmp_path / "recording.db3-wal"):
            (tmp_path / each.name.replace("recording", "broken")).write_bytes(each.read_bytes())
    table = DataTable.read(tmp_path / "broken.db3", columns=["/finger/tip.position.x"], stamps="log")
    assert table.numbers("/finger/tip.position.x").tolist() == [1.0, 2.0, 1.0, 2.0]


def test_without_its_libraries_a_bag_names_the_command(tmp_path, monkeypatch):
    bag = written(tmp_path / "a.mcap", tips([1.0]))
    monkeypatch.setitem(sys.modules, "mcap.reader", None)
    monkeypatch.setitem(sys.modules, "mcap_ros2.writer", None)
    for work in (lambda: DataTable.read(bag), lambda: DataTable.bag({})):
        with pytest.raises(InputError, match=r"bags of ROS 2 need the extra 'ros': .*install"):
            work()


def test_a_configuration_names_topics_and_fields(tmp_path):
    """Moments are published less often than the tip, and not at its stamps."""
    x, y = on_arc(0.04, LENGTH)
    tip = {"position": {"x": x, "y": y, "z": 0.0}, "label": ""}
    points = [("/camera/tip", POINT, k * 10_000_000, tip) for k in range(4)]
    bag = written(tmp_path / "arc.mcap", joints([40.0, 40.0], [-1_000_000, 19_000_000], "/bench") + points)
    data = {
        "kind": "static",
        "max_age": 0.02,
        "conditions": [{"name": "tip_moment", "column": "/bench.position[0] [N mm]"}],
        "measured": [{"quantity": axis, "column": f"/camera/tip.position.{axis}"} for axis in "xy"],
    }
    scene = IdentifyScene(**ROD, data=[data])
    (poses,) = read_data(scene, [bag])
    assert poses.rows == 4
    assert poses.conditions["tip_moment"] == pytest.approx(0.04, rel=1e-15)
    assert np.abs(cg.compare(scene, bag).residuals).max() < 1e-7
    with pytest.raises(InputError) as caught:
        read_data(scene.changed({"data[0].measured[1].column": "/camera/tip.position.v"}), [bag])
    assert caught.value.key == "data[0].measured[1].column"
    with pytest.raises(InputError) as caught:
        read_data(scene.changed({"data[0].max_age": None}), [bag])
    assert caught.value.key == "data[0].max_age"


@cache
def loop():
    return cg.run_closed_loop(cg.load(STEADY, ["duration=0.2"]))


def test_the_bag_of_a_run_reads_back_as_its_log(tmp_path):
    run = loop()
    bag = run.write_mcap(tmp_path / "run.mcap")
    replayed = replay(STEADY, bag)
    assert np.abs(replayed.u - run.u).max() < 1e-9
    assert (replayed.status, replayed.warnings) == ("consistent", ())
    table = DataTable.read(bag)
    for name, column in zip(("tip_x", "tip_y", "tension_1", "tension_2"), run.y.T, strict=True):
        assert np.array_equal(table.numbers(name, gaps=True), column, equal_nan=True)
    assert np.array_equal(table.numbers("commanded_tension_1"), run.u[:, 0])
    assert np.array_equal(table.numbers("reference_tip_y"), run.r[:-1, 1])
    assert np.array_equal(table.numbers("mismatch"), run.mismatch)


def test_compare_takes_a_log_in_a_bag_as_in_a_table(tmp_path):
    finger = {**ROD["finger"], "tendons": {"offset": 0.01, "max_tension": 10.0, "time_constant": 0.02}}
    fidelity = {"family": "arc", "elements": 1}
    scene = cg.Scene(finger=finger, gravity=(0.0, 0.0), fidelity=fidelity, initial={"pose": "rest"})
    t = np.arange(4) / 100.0
    tip = {"tip_x [m]": 0.2 + NUMBERS[:4] / 1e3, "tip_y [m]": NUMBERS[4:8] / 1e3, "tension_1 [N]": 7.0 + t}
    commands = {f"commanded_tension_{k} [N]": np.full(4, 1.0 + k) for k in (1, 2)}
    (tmp_path / "log.mcap").write_bytes(DataTable.bag({"/measured": (t, tip), "/commands": (t, commands)}))
    columns = {"t [s]": t, **tip, **commands}
    rows = [[repr(value) for value in row] for row in np.column_stack([*columns.values()]).tolist()]
    (tmp_path / "log.csv").write_text(Result.as_csv([*columns], rows))
    bag, table = (cg.compare(scene, tmp_path / f"log.{kind}") for kind in ("mcap", "csv"))
    assert np.abs(bag.residuals - table.residuals).max() == 0.0
    assert bag.measured.tolist() == table.measured.tolist()


def test_a_log_is_read_by_the_names_of_its_configuration(tmp_path):
    """Topics of a bench: the camera in millimeters, tensions and commands in lists, each at stamps of its own."""
    run = loop()
    log = run.log
    messages = []
    for t, u, y in zip(log.t, log.u, log.y, strict=True):
        ns = round(t * 1e9)
        point = {"x": 1e3 * y[0], "y": 1e3 * y[1], "z": 0.0}
        messages.append(("/camera", POINT, ns, {"position": point, "label": ""}))
        messages.append(("/cells", JOINTS, ns + 1000, {"name": [], "position": y[2:].tolist(), "load": 0.0}))
        messages.append(("/drives", JOINTS, ns + 2000, {"name": [], "position": u.tolist(), "load": 0.0}))
    bag = written(tmp_path / "bench.mcap", messages)
    columns = {f"tip_{axis}": f"/camera.position.{axis} [mm]" for axis in "xy"}
    columns |= {f"tension_{k + 1}": f"/cells.position[{k}]" for k in range(2)}
    columns |= {f"commanded_tension_{k + 1}": f"/drives.position[{k}]" for k in range(2)}
    scene = cg.load(STEADY, {"log": {"columns": columns}})
    replayed = replay(scene, bag)
    assert (replayed.status, replayed.warnings) == ("consistent", ())
    assert np.abs(replayed.u - run.u).max() < 1e-6
    with pytest.raises(InputError) as caught:
        replay(scene.changed({"log.columns.tip_x": "/camera.x"}), bag)
    assert caught.value.key == "log.columns.tip_x"
    with pytest.raises(InputError, match="no channel is called 'tip_z'"):
        replay(scene.changed({"log.columns": {"tip_z": "/camera.position.z"}}), bag)
    # the same names for a table
    table = tmp_path / "bench.csv"
    table.write_text(log.text().replace("tip_x [m]", "camera x"))
    named = cg.load(STEADY, {"log": {"columns": {"tip_x": "camera x [m]"}}})
    assert np.abs(replay(named, table).u - run.u).max() < 1e-3
    with pytest.raises(InputError, match="the log has 0 instants with all readings"):
        commission(scene, bag)


def test_mpc_writes_a_bag_that_replay_reads(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = CliRunner()
    made = run.invoke(app, ["mpc", STEADY, "--set", "duration=0.3", "--mcap", "loop.mcap", "--no-pictures"])
    assert "loop.mcap" in made.stdout
    replayed = run.invoke(app, ["replay", STEADY, "loop.mcap", "--no-pictures"])
    assert replayed.exit_code == 0, replayed.output
    refused = run.invoke(app, ["mpc", STEADY, "--mcap", "."])
    assert refused.exit_code == 2
