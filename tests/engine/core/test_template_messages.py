"""Templates in another language: what is a message in them, and that nothing else changes."""

from __future__ import annotations

from pathlib import Path

import pytest
from jinja2 import Environment
from slopewatch.engine.core.template_messages import template_messages, translated_template

TEMPLATES = Path("engine/report/templates")


def test_a_message_lies_between_block_elements_and_statements():
    source = """<h2 id="zones">Zones</h2>
<p class="a">{% if many %}{{ fig("metrics", "count") }} {{ "zone" if one else "zones" }} of
   change, <strong>net {{ net }} m</strong>.{% else %}None found.{% endif %}</p>{# not this #}
<td>{{ value }}</td><td>12</td><figure{% if kind %} class="{{ kind }}"{% endif %}>"""
    assert list(template_messages(source)) == [
        "Zones",
        "{0} {1} of change, <strong>net {2} m</strong>.",
        "zone",
        "zones",
        "None found.",
    ]


def test_a_translated_template_says_the_same_in_its_own_order():
    source = '<p>{{ a }} of {{ b }} {{ "one" if x else "more" }} lie here.</p>'
    words = {"{0} of {1} {2} lie here.": "这里有{1}中的{0}{2}。", "one": "个", "more": "些"}
    made = translated_template(source, lambda text: words.get(text, text))
    page = Environment(autoescape=True).from_string(made)
    assert page.render(a=1, b=2, x=True) == "<p>这里有2中的1个。</p>"
    assert page.render(a=1, b=2, x=False) == "<p>这里有2中的1些。</p>"


@pytest.mark.parametrize("name", sorted(path.name for path in (Path(__file__).parents[3] / TEMPLATES).glob("*.j2")))
def test_without_translations_a_template_stays_as_it_is(name, root):
    source = (root / TEMPLATES / name).read_text(encoding="utf-8")
    same = translated_template(source, lambda text: text)
    assert same.split() == source.split()
    assert list(template_messages(source))
    marked = translated_template(source, lambda text: f"«{text}»")
    Environment(autoescape=True).parse(marked)
    assert marked.count("«") >= len(set(template_messages(source)))
