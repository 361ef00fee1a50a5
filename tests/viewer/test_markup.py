"""HTML of the page: nothing from outside becomes markup."""

import pytest
from jinja2 import UndefinedError

from wrenchgap.viewer import markup


def test_text_is_safe_in_html_and_in_attributes():
    made = markup.render("table", heading='<b onclick="x">&', head=(), rows=(), sentences=(), look="")
    assert "&lt;b onclick=&#34;x&#34;&gt;&amp;" in made


def test_a_template_that_is_given_too_little_is_an_error():
    with pytest.raises(UndefinedError):
        markup.render("table", heading="")
