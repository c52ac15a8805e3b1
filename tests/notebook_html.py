"""Check of the HTML of results in notebooks."""

from html.parser import HTMLParser


class Tags(HTMLParser):
    """Check that every element is closed."""

    def __init__(self):
        super().__init__()
        self.open, self.seen = [], []

    def handle_starttag(self, tag, attributes):
        self.seen.append(tag)
        if tag not in ("img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def assert_html(value, *texts):
    page = value._repr_html_()
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    assert "img" in tags.seen
    assert len(page) < 200_000
    for text in texts:
        assert text in page
    return page
