"""What failures say."""

import pytest

from streamkit import ElementFailure, Pipeline, ResourceError, Source


@pytest.mark.parametrize("text", ["it is broken", "bad0: it is broken"])
def test_an_element_is_named_once(register, text: str) -> None:
    """Whether or not the error of the element names it already."""

    class Bad(Source):
        src = "a/b"

        def start(self) -> None:
            raise ResourceError(text)

    register(bad=Bad)
    with pytest.raises(ElementFailure) as failure:
        Pipeline.parse("bad ! fakesink").run(timeout_s=10)
    assert str(failure.value) == "bad0: it is broken"
