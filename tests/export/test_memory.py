"""Arrays that share memory never disturb each other: random programs, run in shared memory and in
memory without end."""

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from faultgauge.export.memory import Array, Branch, CLoop, Statement, place

SIZES = (1, 2, 3)
FIXED = 2  # arrays whose place is given, and that last


def program(draw):
    """(arrays, nodes)."""
    arrays = [Array(2, "real", fixed=f"f{k}") for k in range(FIXED)]

    def nodes(depth, known):
        found = []
        for _ in range(draw(st.integers(1, 5))):
            kind = draw(st.integers(0, 5)) if depth < 2 else 0
            if kind == 4:
                ways = [("", nodes(depth + 1, list(known))) for _ in range(2)]
                found.append(Branch(ways))
            elif kind == 5:
                found.append(CLoop("", nodes(depth + 1, list(known))))
            else:
                found.append(statement(known))
        return found

    def statement(known):
        reads = set(draw(st.lists(st.sampled_from(known), max_size=2)))
        how = draw(st.integers(0, 3))
        if how == 0:
            new = draw(st.sampled_from(arrays[:FIXED]))  # the state goes on
        elif how == 1:
            new = draw(st.sampled_from(known))
        else:
            new = Array(draw(st.sampled_from(SIZES)), "real")
            arrays.append(new)
        part = new in known and draw(st.booleans())
        there = {each for each in reads if each.size == new.size and each is not new}
        there = there if draw(st.booleans()) and not part else set()
        copy = len(reads) == 1 and reads == there
        if new not in known:
            known.append(new)
        return Statement(["x"], {new}, reads - there, there, part, copy)

    return arrays, nodes(0, list(arrays))


def run(nodes, arrays, cells):
    """What the fixed arrays hold in the end; `cells` are where the numbers of an array lie."""
    memory, turn = {}, [0]

    def walk(nodes):
        for each in nodes:
            if isinstance(each, CLoop):
                walk(each.body)
                walk(each.body)
            elif isinstance(each, Branch):
                turn[0] += 1
                walk(each.ways[turn[0] % 2][1])
            elif not (cells is not None and each.idle):
                act(each)

    def act(each):
        at = spread if cells is None else cells
        own = sorted(each.reads | each.there, key=arrays.index)
        old = [memory.get(cell, 0) for array in own for cell in at(array)]
        (new,) = each.writes
        for k, cell in enumerate(at(new)):
            if each.part and k % 2:
                continue
            if each.copy:
                memory[cell] = memory.get(at(own[0])[k], 0)
            elif each.there and not each.reads:
                memory[cell] = hash((tuple(memory.get(at(a)[k], 0) for a in own), len(each.lines)))
            else:
                memory[cell] = hash((tuple(old), k))

    def spread(array):
        return [(arrays.index(array), k) for k in range(array.size)]

    walk(nodes)
    at = spread if cells is None else cells
    return [memory.get(cell, 0) for array in arrays[:FIXED] for cell in at(array)]


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_shared_memory_holds_what_unlimited_memory_would(data):
    arrays, nodes = program(data.draw)
    wanted = run(nodes, arrays, None)
    sizes = place(nodes, arrays, set(arrays[:FIXED]))

    def cells(array):
        home = array.home
        return [(home.fixed, home.offset + k) for k in range(array.size)]

    for array in arrays:
        inside = array.home.fixed or array.home.offset + array.size <= sizes.get("real", 0)
        assert inside
    assert run(nodes, arrays, cells) == wanted


def test_a_chain_of_loops_needs_the_memory_of_one_array():
    """Each array is made of the one before, at the same places, and read once."""
    arrays = [Array(7, "real") for _ in range(6)]
    nodes = [Statement(["x"], {arrays[0]})]
    for old, new in pairwise(arrays):
        nodes.append(Statement(["x"], {new}, there={old}))
    assert place(nodes, arrays, set()) == {"real": 7}


def test_arrays_that_are_read_together_lie_apart():
    a, b, c = (Array(4, "real") for _ in range(3))
    nodes = [Statement(["x"], {a}), Statement(["x"], {b}), Statement(["x"], {c}, reads={a, b})]
    assert place(nodes, [a, b, c], {c}) == {"real": 12}
    spans = [set(range(each.home.offset, each.home.offset + 4)) for each in (a, b, c)]
    assert len(set.union(*spans)) == 12
