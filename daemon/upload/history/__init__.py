"""Records of uploads: their journal, its head, and the files that were active before."""
