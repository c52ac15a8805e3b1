"""The small reader of YAML."""

import pytest

from omnisight.formats._yaml import read


def test_yaml_reader():
    text = """%YAML:1.0
---
# a comment
a: 1   # another
b:1.5
"c d": 'it''s # no comment'
e: {x: 1, "y": [true, null, .5, -1e-3,
      2.], z: {}}
f:
    g: "a\\nb"
\th: ~
list:
- 1
- - 2
  - [3]
- k: v
  l: /cam0/x:y
-
  m: 1
empty:
last: 2026-01-02 text"""
    assert read(text.replace("\th: ~", "    h: ~")) == {
        "a": 1,
        "b": 1.5,
        "c d": "it's # no comment",
        "e": {"x": 1, "y": [True, None, 0.5, -1e-3, 2.0], "z": {}},
        "f": {"g": "a\nb", "h": None},
        "list": [1, [2, [3]], {"k": "v", "l": "/cam0/x:y"}, {"m": 1}],
        "empty": None,
        "last": "2026-01-02 text",
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\na: 2", "line 2: duplicate"),
        ("a: [1, 2", "expected a comma or ]"),
        ("a: {b 1}", "expected a colon after 'b'"),
        ("a: 1\n  b: 2", "wrong indentation|line 2"),
        ("a: [1] 2", "unexpected"),
        ("a: &x 1", "anchors"),
        ("a: |\n  text", "multi-line"),
        ("a: 1\njust words", "line 2: expected a name"),
        ("a:\n" + "".join(" " * i + f"a{i}:\n" for i in range(1, 40)), "levels"),
    ],
)
def test_yaml_errors_name_the_line(text, message):
    with pytest.raises(ValueError, match=message):
        read(text)
