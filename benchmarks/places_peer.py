"""Image retrieval by COLMAP's vocabulary tree, as a process: `python -m benchmarks.places_peer in.npz out.json`."""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
import pycolmap

WORDS = 4096


def main(source: str, target: str) -> None:
    """Write the references (indices) in the order of their similarity, for each query.

    The vocabulary is trained on the references, because pycolmap has none.
    """
    arrays = np.load(source)
    references, queries = int(arrays["references"]), int(arrays["queries"])
    # As COLMAP stores them.
    descriptors = [np.rint(512 * arrays[f"d{i}"]).clip(0, 255) for i in range(references + queries)]
    index = pycolmap.VisualIndex.create(128, 64)
    options = pycolmap.VisualIndex.BuildOptions()
    options.num_visual_words = WORDS
    index.build(options, _features(np.concatenate(descriptors[:references]).astype(np.float32)))
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree.bin"
        index.write(tree)
        ranked = _ranked(Path(folder) / "database.db", tree, descriptors, arrays["pixels"], references)
    Path(target).write_text(json.dumps(ranked))


def _features(descriptors):
    return pycolmap.FeatureDescriptorsFloat(pycolmap.FeatureExtractorType.SIFT, descriptors)


def _ranked(database_path, tree, descriptors, size, references):
    database = pycolmap.Database.open(database_path)
    camera = pycolmap.Camera(
        model="EQUIRECTANGULAR", width=int(size[0]), height=int(size[1]), params=size.astype(float)
    )
    camera_id = database.write_camera(camera)
    ids = []
    for i, each in enumerate(descriptors):
        image_id = database.write_image(pycolmap.Image(name=f"{i:04d}", camera_id=camera_id))
        database.write_keypoints(image_id, np.zeros((len(each), 4), np.float32))
        stored = pycolmap.FeatureDescriptors(pycolmap.FeatureExtractorType.SIFT, each.astype(np.uint8))
        database.write_descriptors(image_id, stored)
        ids.append(image_id)
    options = pycolmap.VocabTreePairingOptions(num_images=len(descriptors), vocab_tree_path=tree)
    number = {image_id: i for i, image_id in enumerate(ids)}
    found = {i: [] for i in range(references, len(descriptors))}
    generator = pycolmap.VocabTreePairGenerator(options, database, ids[references:])
    while not generator.has_finished():
        for pair in generator.next():
            a, b = (number[each] for each in pair)
            query, other = (a, b) if a >= references and b < references else (b, a)
            if query >= references > other:
                found[query].append(other)
    return list(found.values())


if __name__ == "__main__":
    main(*sys.argv[1:])
