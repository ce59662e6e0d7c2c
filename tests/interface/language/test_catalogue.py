"""Catalogues in gettext's format, and sentences found by their pattern."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from slopewatch.interface.language import (
    LANGUAGES,
    Translator,
    language_of,
    language_of_environment,
    read_catalogue,
    translator,
)
from slopewatch.interface.language.catalogue import CatalogueError

# As in the GNU gettext manual, "The Format of PO Files".
SAMPLE = r"""
# A translator's comment
msgid ""
msgstr "Language: zh_CN\n"

#: lib/error.c:116
msgid "Unknown system error"
msgstr "未知的系统错误"

#. for the dialog
msgid ""
"two "
"parts\n"
msgstr "两"
"部分\n"
msgid "a \"quoted\" \\ word"
msgstr "“引用”"

#, fuzzy
msgid "doubtful"
msgstr "可疑"

msgid "empty"
msgstr ""

#~ msgid "obsolete"
#~ msgstr "过时"
"""


def catalogue(tmp_path: Path, text: str) -> dict[str, str]:
    path = tmp_path / "x.po"
    path.write_text(text, encoding="utf-8")
    return read_catalogue(path)


def test_a_catalogue_as_the_manual_of_gettext_writes_it(tmp_path):
    assert catalogue(tmp_path, SAMPLE) == {
        "Unknown system error": "未知的系统错误",
        "two parts\n": "两部分\n",
        'a "quoted" \\ word': "“引用”",
    }


@pytest.mark.parametrize("text", ['msgid "open', 'msgid "a"\nmsgstr 3', '"of nothing"', "msgid plain"])
def test_a_damaged_catalogue_names_the_line(tmp_path, text):
    with pytest.raises(CatalogueError, match=r"x\.po, line \d"):
        catalogue(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("The file a.laz has 3 points.", "文件a.laz有3个点。"),
        ("The file b of c.laz has no points.", "文件b of c.laz没有点。"),  # the more specific one
        ("Cell size", "单元尺寸"),
        ("never heard of", "never heard of"),
        ("The file a.laz has 3 points. Cell size", "文件a.laz有3个点。单元尺寸"),
        ("never heard of. Cell size", "never heard of. 单元尺寸"),
        ("counted from 1 to 2", "2以前、1以后"),
        ("The file Cell size has 3 points.", "文件单元尺寸有3个点。"),
        ("one\nCell size", "one\n单元尺寸"),
        ("50 {percent} is much", "五十{percent}很多"),
        ("a within the region b; Cell size", "b范围内的a；单元尺寸"),
        ("a.laz: Cell size.", "a.laz：单元尺寸。"),
        ("Cell size or Cell size", "单元尺寸或单元尺寸"),
        ("Cell size or another", "Cell size or another"),  # a list of words is translated as a whole or not at all
        ("a.laz within the region r.gpkg", "r.gpkg范围内的a.laz"),
        ("/x is no record (why not)", "/x不是记录（why not）"),
        ("The cloud of the later survey", "later期点云"),
        ("Cell size (m)", "单元尺寸 (m)"),
        ("x is y", "x is y"),  # too little of its own
        ("", ""),
    ],
)
def test_sentences_are_found_by_their_pattern(text, expected):
    translate = Translator(
        {
            "The file {0} has {1} points.": "文件{0}有{1}个点。",
            "The file {0} has no points.": "文件{0}没有点。",
            "Cell size": "单元尺寸",
            "counted from {0} to {1}": "{1}以前、{0}以后",
            "{0} {{percent}} is much": "五十{{percent}}很多",
            "{0} within the region {1}": "{1}范围内的{0}",
            " within the region {0}": "（{0}范围内）",
            "{path} is no record ({why})": "{path}不是记录（{why}）",
            "The cloud of the {} survey": "{}期点云",
            "{0} is {1}": "{0}是{1}",
        }
    )
    assert translate(text) == expected


@given(st.text(max_size=200), st.text(max_size=50))
def test_whatever_stands_in_a_place_is_kept(name, other):
    """Values with braces, blanks or the characters of patterns neither break nor change."""
    translate = Translator({"The file {0} has no points in {1}; check it.": "{1}中的文件{0}没有点；请检查。"})
    name, other = name.replace(" has no points in ", ""), other.replace("; check it.", "")
    said = translate(f"The file {name} has no points in {other}; check it.")
    assert said == f"{other}中的文件{name}没有点；请检查。"


@pytest.mark.parametrize(
    ("locale", "language"),
    [("zh_CN.UTF-8", "zh_CN"), ("zh-Hans-CN", "zh_CN"), ("zh", "zh_CN"), ("zh_TW", "en"), ("de_DE", "en"), ("C", "en")],
)
def test_the_language_of_a_locale(locale, language):
    assert language_of(locale) == language


def test_the_environment_is_asked_in_gettexts_order():
    assert language_of_environment({}) == "en"
    assert language_of_environment({"LANG": "zh_CN.UTF-8"}) == "zh_CN"
    assert language_of_environment({"LANG": "zh_CN.UTF-8", "LC_ALL": "C"}) == "en"
    assert language_of_environment({"LC_ALL": "C", "SLOPEWATCH_LANGUAGE": "zh_CN"}) == "zh_CN"
    assert language_of_environment({"SLOPEWATCH_LANGUAGE": "auto", "LANG": "de_DE"}) == "en"


def test_every_language_has_a_catalogue_that_is_read():
    for language in LANGUAGES:
        assert translator(language)("Cell size") == ("Cell size" if language == "en" else "单元尺寸")
    with pytest.raises(ValueError, match="give one of en, zh_CN"):
        translator("tlh")
