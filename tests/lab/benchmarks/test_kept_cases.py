"""A long benchmark goes on where it was cut, and measures nothing twice."""

from __future__ import annotations

from slopewatch.lab.benchmarks.kept_cases import KeptCases


def measured(cases: KeptCases, name: str, value: object, calls: list[str]) -> object:
    def measure() -> object:
        calls.append(name)
        return value

    return cases.get(name, measure)


def test_what_was_measured_is_kept_and_not_measured_again(tmp_path):
    store, calls = tmp_path / "new" / "cases.jsonl", []
    for _ in range(2):
        cases = KeptCases(store)
        assert measured(cases, "a", {"error": [1.5, -2.0], "zones": 3}, calls) == {"error": [1.5, -2.0], "zones": 3}
        assert measured(cases, "b", (1, 2), calls) == [1, 2]
    assert calls == ["a", "b"]


def test_a_line_that_was_cut_is_measured_again_and_harms_no_other(tmp_path):
    store, calls = tmp_path / "cases.jsonl", []
    measured(KeptCases(store), "a", 1, calls)
    with store.open("a", encoding="utf-8") as file:
        file.write('{"case": "b", "fou')
    assert measured(KeptCases(store), "b", 2, calls) == 2
    assert measured(KeptCases(store), "a", 9, calls) == 1
    assert measured(KeptCases(store), "b", 9, calls) == 2
    assert calls == ["a", "b"]


def test_without_a_file_cases_are_kept_in_memory_only(tmp_path):
    cases, calls = KeptCases(), []
    assert [measured(cases, "a", 1, calls) for _ in range(2)] == [1, 1]
    assert calls == ["a"]
    assert list(tmp_path.iterdir()) == []
