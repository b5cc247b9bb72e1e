"""What running programs needs besides the method itself: compilation, threads, processes, files, batch sizes."""
