"""The data set: verdicts on action sequences of many scenes, their files, and the training examples made of them."""
