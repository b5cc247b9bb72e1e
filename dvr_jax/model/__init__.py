"""Action-object images, the convolutional recurrent network on them, its training, and what the searches ask of it."""
