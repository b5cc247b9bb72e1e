"""Plan with the depth image of a camera in place of the rendered one."""

from dataclasses import replace

import numpy as np

import dvr_jax as dvr
from dvr_jax.model.images import depth_images
from dvr_jax.scene.camera import DepthImage, render_depth

# A multiple of 64, the size of the network's own images.
PIXELS = 256

[scene] = dvr.sample_scenes(1, objects=2, seed=7)

# A rendered image stands for your camera's: it looks straight down from 2.6 m over the middle of the table.
rendered = render_depth(scene, PIXELS, PIXELS)

# Make it look real: 3 mm of noise, and one pixel in fifty without a measurement.
generator = np.random.default_rng(0)
depth = rendered.depth + generator.normal(scale=0.003, size=rendered.depth.shape)
depth[generator.random(depth.shape) < 0.02] = np.nan

image = DepthImage(
    depth=depth.astype(np.float32),
    object_masks=rendered.object_masks,
    goal_mask=rendered.goal_mask,
)

# The predictor uses these images wherever it would have rendered the scene.
predictor = dvr.Predictor.shipped("dvr")
predictor = replace(predictor, images=depth_images(scene, image, size=64))

result = dvr.plan(scene, network=predictor, time_limit=600)
print(result.status, *result.action_descriptions, sep="\n  ")
