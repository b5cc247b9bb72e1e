"""What computations run on: compiled programs and their cache, threads, processes, files, sizes of batches."""
