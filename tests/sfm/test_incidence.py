import numpy as np
import pytest

from omnisight.sfm.incidence import grouped


@pytest.mark.parametrize("values", [[], [5], [3, 1, 3, 3, 7, 1]])
def test_groups_are_the_indices_of_each_value(values):
    found = {value: indices.tolist() for value, indices in grouped(np.array(values, np.intp))}
    assert found == {value: [i for i, each in enumerate(values) if each == value] for value in values}
    assert list(found) == sorted(found)
