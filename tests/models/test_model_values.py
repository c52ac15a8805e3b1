"""Every camera model as a value: its parameters, its dictionary, its words, and its fit."""

import dataclasses
import re

import numpy as np
import pytest

from every_model import AZIMUTHS, bounds, direction, every_model, rim
from omnisight.models import CameraModel, model_class, model_names


@every_model
def test_a_model_is_immutable(model):
    assert dataclasses.is_dataclass(model)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(model, dataclasses.fields(model)[0].name, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        model.params[0] = 1.0
    assert model == type(model).example()
    assert hash(model) == hash(type(model).example())
    assert type(model).name in model_names()
    assert isinstance(model, CameraModel)


@every_model
def test_dictionary_and_vector_round_trip(model):
    assert type(model).from_dict(model.to_dict()) == model
    assert tuple(model.to_dict()) == model.param_names
    assert model.with_params(model.params) == model
    other = model.with_params(model.params + 1)
    np.testing.assert_array_equal(other.params, model.params + 1)
    for wrong in (model.params[:-1], np.append(model.params, 0.0), model.params[None]):
        with pytest.raises(ValueError, match=rf"{model.name} has {model.params.size} parameters.*{wrong.shape[0]}"):
            model.with_params(wrong)


@every_model
def test_an_invalid_dictionary_is_rejected_by_name(model):
    cls, good = type(model), model.to_dict()
    first = model.param_names[0]
    with pytest.raises(ValueError, match=f"{cls.name}.*missing.*{first}"):
        cls.from_dict({n: v for n, v in good.items() if n != first})
    with pytest.raises(ValueError, match=f"{cls.name}.*zoom"):
        cls.from_dict(good | {"zoom": 2.0})
    for bad in (np.nan, np.inf, True, None, "1", [1.0]):
        with pytest.raises(ValueError, match=f"{cls.name}.{first}.*finite"):
            cls.from_dict(good | {first: bad})


@every_model
def test_parameters_are_documented(model):
    low, high = bounds(model)
    assert (low <= model.params).all()
    assert (model.params <= high).all()
    for p in model.parameters:
        assert len(p.doc) > 5
        assert p.unit in ("", "px")
    assert len(set(model.param_names)) == model.params.size


@every_model
def test_docstrings_contain_equations(model):
    doc = type(model).__doc__
    assert re.search(r"\b\w+'? = ", doc)
    assert "alid" in doc


@every_model
def test_fit_recovers_the_example(model):
    share = 0.9 if model.theta_max > np.pi / 2 else np.radians(80) / model.theta_max
    rng = np.random.default_rng(3)
    which = rng.integers(len(AZIMUTHS), size=500)
    limit = np.minimum(rim(model)[which], share * model.theta_max)
    bearings = direction(limit * np.sqrt(rng.uniform(0, 1, 500)) * 0.999, AZIMUTHS[which])
    pixels, valid = model.project(bearings)
    assert valid.all()
    fitted = type(model).fit(bearings, pixels)
    again, valid_again = fitted.project(bearings)
    assert valid_again.all()
    assert np.abs(again - pixels).max() < 1e-6


def test_an_unknown_model_is_rejected_with_the_names():
    with pytest.raises(ValueError, match=r"unknown camera model 'pinhol'.*pinhole"):
        model_class("pinhol")
