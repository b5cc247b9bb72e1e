"""Scenes: table, two Panda arms, objects and a goal; their files, their MuJoCo model, their camera, their sampling."""
