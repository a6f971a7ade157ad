"""The syntax trees of the whole house go with the last test of this room."""

from collections.abc import Iterator

import pytest

from tests.architecture import structure


@pytest.fixture(scope="package", autouse=True)
def trees_go() -> Iterator[None]:
    """Millions of objects, through which each later full collection would walk: 5 to 10 s."""
    yield
    structure.trees.cache_clear()
