"""Laws of image retrieval, on rendered panoramas of two rooms."""

import dataclasses

import numpy as np
import pytest

import omnisight as om
from omnisight.features import FeatureOptions, detect_features
from omnisight.places.place_index import MAX_BIT_SHARE, SEARCHED_WORDS, SIMILARITY_BIT_SHARE
from omnisight.places.vocabulary import binary_descriptors, load_vocabulary
from omnisight.simulation import Renderer, scene_named

CAMERA = om.sphere(480)
SCENES = ("room", "street")
# Positions of three images along a line in each scene, m.
STEPS = (0.0, 0.3, 0.6)

PLACES = [(scene, step) for scene in SCENES for step in STEPS]


@pytest.fixture(scope="module")
def panoramas():
    """Return an image at each place."""
    images = []
    for name, step in PLACES:
        scene = scene_named(name)
        pose = om.Pose(translation=np.add(np.mean(scene.free, axis=0), (step, 0, 0)))
        images.append(Renderer(CAMERA, pose, scene, samples=1)(noise=0.0).image)
    return images


@pytest.fixture(scope="module")
def images(panoramas):
    """Return the keypoints at each place."""
    found = [detect_features(panorama, CAMERA) for panorama in panoramas]
    assert min(len(each) for each in found) > 200
    return found


def index_of(images, kind="sift"):
    index = om.PlaceIndex(kind)
    assert [index.add(each) for each in images] == list(range(len(images)))
    return index


def test_an_image_finds_itself(images):
    index = index_of(images)
    for number, keypoints in enumerate(images):
        first, second = index.query(keypoints)[:2]
        assert first.image == number
        assert second.score < first.score < 1


def test_an_image_finds_those_of_the_same_scene_before_others(images):
    index = index_of(images)
    for (scene, _), keypoints in zip(PLACES, images, strict=True):
        ranked = [PLACES[place.image][0] for place in index.query(keypoints, len(STEPS))]
        assert ranked == [scene] * len(STEPS)


def test_a_binary_descriptor_of_orb_finds_the_same_scene(panoramas):
    images = [detect_features(panorama, CAMERA, FeatureOptions("orb")) for panorama in panoramas]
    index = index_of(images, "orb")
    for (scene, _), keypoints in zip(PLACES, images, strict=True):
        assert {PLACES[place.image][0] for place in index.query(keypoints, len(STEPS))} == {scene}


def test_a_quarter_turn_of_the_camera_changes_no_score(panoramas, images):
    index = index_of(images)
    for panorama, keypoints in zip(panoramas, images, strict=True):
        turned = detect_features(np.roll(panorama, CAMERA.width // 4, axis=1), CAMERA)
        before, after = index.query(keypoints), index.query(turned)
        assert [place.image for place in after[:3]] == [place.image for place in before[:3]]
        np.testing.assert_allclose([p.score for p in after[:3]], [p.score for p in before[:3]], atol=0.01)


@pytest.mark.parametrize("columns", [37, 200, 411])
def test_any_heading_finds_the_same_image(panoramas, images, columns):
    index = index_of(images)
    for number, panorama in enumerate(panoramas):
        turned = detect_features(np.roll(panorama, columns, axis=1), CAMERA)
        assert index.query(turned, 1)[0].image == number


def test_images_added_later_do_not_change_a_query_before_them(images):
    whole, growing = index_of(images), om.PlaceIndex()
    for number, keypoints in enumerate(images):
        assert growing.query(keypoints) == whole.query(keypoints, before=number)
        growing.add(keypoints)
    assert growing.query(images[0]) == whole.query(images[0])


def test_votes_are_those_of_a_direct_computation(images):
    images = [each[:300] for each in images]
    vocabulary = load_vocabulary("sift")
    bits = [(each.descriptors > vocabulary.thresholds).astype(float) for each in images]
    nearest = [vocabulary.nearest(vocabulary.bits(each), SEARCHED_WORDS) for each in images]
    expected = np.zeros(len(images))
    for query, searched in zip(bits[1], nearest[1], strict=True):
        similarity = np.zeros(len(images))
        for number, (entries, (word, *_)) in enumerate((b, n.T) for b, n in zip(bits, nearest, strict=True)):
            entries = entries[np.isin(word, searched)]
            share = _different(query[None], entries)[0] / 128
            share = share[share <= MAX_BIT_SHARE]
            similarity[number] = np.exp(-((share / SIMILARITY_BIT_SHARE) ** 2)).max(initial=0)
        expected += similarity / (1 + similarity.sum()) / 300
    scores = np.zeros(len(images))
    for place in index_of(images).query(images[1]):
        scores[place.image] = place.score
    np.testing.assert_allclose(scores, expected, rtol=1e-9)


@pytest.mark.parametrize("kind", ["sift", "orb"])
def test_most_descriptors_are_assigned_to_the_nearest_word(panoramas, kind):
    vocabulary = load_vocabulary(kind)
    found = vocabulary.bits(detect_features(panoramas[0], CAMERA, FeatureOptions(kind)))
    bits, words = (np.unpackbits(each.view(np.uint8), axis=1).astype(float) for each in (found, vocabulary.words))
    distances, nearest = _different(bits, words), vocabulary.nearest(found, 1)
    assert (np.take_along_axis(distances, nearest, 1)[:, 0] == distances.min(axis=1)).mean() > 0.85


def _different(a, b):
    """Return the numbers (N, M) of different bits of descriptors (N, D) and (M, D) of zeros and ones."""
    return a @ (1 - b).T + (1 - a) @ b.T


def test_pairs_are_neighbours_in_the_same_scene(images):
    steps = []
    pairs = om.similar_pairs(images, len(STEPS) - 1, lambda done, total: steps.append((done, total)))
    assert pairs == [(0, 1), (0, 2), (1, 2), (3, 4), (3, 5), (4, 5)]
    assert steps == [(done, 2 * len(images)) for done in range(1, 2 * len(images) + 1)]
    assert om.similar_pairs(images, len(STEPS) - 1) == pairs


def test_an_image_without_keypoints_is_similar_to_none(images):
    empty = images[0][:0]
    index = index_of([empty, *images])
    assert index.query(empty) == []
    assert 0 not in [place.image for place in index.query(images[0])]
    assert om.PlaceIndex().query(images[0]) == []
    assert om.similar_pairs([]) == []


def test_descriptors_of_another_kind_are_an_error(images):
    other = dataclasses.replace(images[0], descriptors=np.zeros((len(images[0]), 32), np.uint8))
    index = index_of(images[:1])
    for call in (index.add, index.query):
        with pytest.raises(ValueError, match=r"float32 x 128.*uint8 x 32"):
            call(other)
    assert len(index) == 1
    with pytest.raises(ValueError, match=r"'xfeat'.*sift or orb"):
        om.PlaceIndex("xfeat")


def test_bits_are_the_comparison_with_the_thresholds():
    descriptors, thresholds = np.zeros((1, 64), np.float32), np.full(64, 0.5, np.float32)
    descriptors[0, [0, 9]] = 1
    assert np.unpackbits(binary_descriptors(descriptors, thresholds).view(np.uint8)).nonzero()[0].tolist() == [0, 9]
