"""Result and helpers of the tests of figures."""

import pytest
from results import made_up_result


@pytest.fixture(scope="module")
def result():
    return made_up_result()
