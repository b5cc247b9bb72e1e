"""Search over action sequences: the tree, its bounds, breadth-first and multi-bound search."""
