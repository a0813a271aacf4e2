"""What the levels of a lattice go through, each thing once, however many memories and trials share it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from taskcomm.lattice import Ints, Lattice

WORTHWHILE = 100_000  # levels in a range of units: a pass over fewer is done before a thread has begun
MEMORY = 5  # levels that take as long as a memory


class Courses(NamedTuple):
    """Where the level of every memory at every step is to be found.

    A *line* is the level of one approval under the cues and rests seen since a reset. Tracks that saw the
    same are on one line, one that saw its beginning too: line l is traced along track `line_track[l]` and
    stored from `line_at[l]` to `line_at[l + 1]`.

    A *course* is the levels of all approvals of a memory, side by side: what holds for a stretch of steps
    is there once, for all memories that go through it. Cell c of the courses, `course_at[k]` to
    `course_at[k + 1]` for course k, has the levels `cell_level[c]` (M,); memory s is at step t in cell
    `memory_cell[s] + t`, from the first step of its layer to its event, or to the step after the trial,
    whose cell repeats levels before it.

    Nothing is shared between the `ranges` of units, so that they can be worked on at once: units u to v, a
    range, have the lines `unit_lines[u]` to `unit_lines[v]` and the courses `unit_courses[u]` to
    `unit_courses[v]`.
    """

    line_track: Ints
    line_at: Ints
    unit_lines: Ints
    course_at: Ints
    cell_level: Ints
    unit_courses: Ints
    memory_cell: Ints


def courses_of(lattice: Lattice) -> tuple[Courses, list[tuple[int, int]]]:
    """The courses of a lattice, and its ranges of units of about equal work."""
    longest, line = _lines(lattice)
    ranges = _ranges(lattice, lattice.track_length[longest], line)
    parts = [_part(lattice, longest, line, first, last) for first, last in ranges]
    lines, courses = np.zeros((2, len(lattice.unit_layers)), dtype=np.int64)
    levels = cells = 0
    for n, ((first, last), part) in enumerate(zip(ranges, parts, strict=True)):
        lines[first + 1 : last + 1] = lines[first] + len(part.line_track)
        courses[first + 1 : last + 1] = courses[first] + len(part.course_at) - 1
        moved = {"line_at": part.line_at + levels, "cell_level": part.cell_level + levels}
        levels += part.line_at[-1]
        moved |= {"course_at": part.course_at + cells, "memory_cell": part.memory_cell + cells}
        cells += part.course_at[-1]
        parts[n] = part._replace(**moved)
    joined = Courses(
        line_track=np.concatenate([part.line_track for part in parts]),
        line_at=np.concatenate([[0], *(part.line_at[1:] for part in parts)]),
        unit_lines=lines,
        course_at=np.concatenate([[0], *(part.course_at[1:] for part in parts)]),
        cell_level=np.concatenate([part.cell_level for part in parts]),
        unit_courses=courses,
        memory_cell=np.concatenate([part.memory_cell for part in parts]),
    )
    return joined, ranges


def _lines(lattice: Lattice) -> tuple[Ints, Ints]:
    """The longest track of every line, and the line of every track."""
    seen = [_seen(lattice, track) for track in range(len(lattice.track_state))]
    order = sorted(range(len(seen)), key=seen.__getitem__, reverse=True)  # a beginning comes after the whole
    longest: list[int] = []
    line = np.zeros(len(seen), dtype=np.int64)
    for track in order:
        if not longest or not seen[longest[-1]].startswith(seen[track]):
            longest.append(track)
        line[track] = len(longest) - 1
    return np.array(longest, dtype=np.int64), line


def _seen(lattice: Lattice, track: int) -> bytes:
    """Everything that the level along a track depends on, step by step."""
    first, length = int(lattice.track_first[track]), int(lattice.track_length[track])
    before = min(first, lattice.lag)
    at, rest = int(lattice.track_cue[track]) + first, int(lattice.track_rest[track]) + first
    cues, rests = lattice.cues[at - before : at + length], lattice.rests[rest : rest + length]
    late = bytes(lattice.lag - before) + cues[:before].tobytes()
    return int(lattice.track_state[track]).to_bytes(4, "big") + late + (cues[before:] | rests << 1).tobytes()


def _ranges(lattice: Lattice, length: Ints, line: Ints) -> list[tuple[int, int]]:
    """Ranges of units, as many as are worth a thread's while."""
    _, first = np.unique(line, return_index=True)  # a line is work where it is first met
    new = np.zeros(len(line) + 1, dtype=np.int64)
    new[1 + first] = length
    memories = lattice.layer_memories[lattice.unit_layers]
    work = np.cumsum(new)[lattice.unit_tracks] + MEMORY * memories
    parts = int(min(16, max(1, work[-1] // WORTHWHILE)))
    cuts = np.searchsorted(work, np.linspace(0, work[-1], parts + 1)[1:-1])
    ends = np.unique([0, *cuts.tolist(), len(work) - 1])
    return list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))


def _part(lattice: Lattice, longest: Ints, line: Ints, first: int, last: int) -> Courses:
    """The lines and courses of some units alone, counted from 0."""
    tracks, layers = slice(*lattice.unit_tracks[[first, last]]), slice(*lattice.unit_layers[[first, last]])
    bounds = lattice.layer_memories[layers.start : layers.stop + 1]
    used, track_line = np.unique(line[tracks], return_inverse=True)
    line_at = np.concatenate([[0], np.cumsum(lattice.track_length[longest[used]])])
    track = lattice.memory_track[bounds[0] : bounds[-1]] - tracks.start
    lines, level = track_line[track], (line_at[track_line] - lattice.track_first[tracks])[track]
    at_first = np.repeat(lattice.layer_first[layers], np.diff(bounds)) + level[:, 0]
    at_event = np.repeat(lattice.layer_press[layers], np.diff(bounds)) + level[:, 0]
    _, one, course = _alike(np.hstack([lines, level[:, 1:] - level[:, :1]]))
    begin, end = np.full(len(one), np.iinfo(np.int64).max), np.zeros(len(one), dtype=np.int64)
    np.minimum.at(begin, course, at_first)
    np.maximum.at(end, course, at_event + 1)
    course_at = np.concatenate([[0], np.cumsum(end - begin)])
    place = np.arange(course_at[-1]) - np.repeat(course_at[:-1] - begin, end - begin)
    levels = place[:, None] + np.repeat(level[one] - level[one, :1], end - begin, axis=0)
    return Courses(
        line_track=longest[used],
        line_at=line_at,
        unit_lines=np.zeros(0, dtype=np.int64),
        course_at=course_at,
        cell_level=np.minimum(levels, np.repeat(line_at[lines[one] + 1] - 1, end - begin, axis=0)),
        unit_courses=np.zeros(0, dtype=np.int64),
        memory_cell=(course_at[:-1] - begin)[course] + level[:, 0],
    )


def _alike(rows: Ints) -> Sequence[Ints]:
    """The distinct rows, where each is first, and which of them each row is."""
    distinct, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return distinct, first, which.reshape(-1)
