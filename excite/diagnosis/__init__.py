"""Where a model and a robot's record differ, which effect explains it, and how far the gap shrinks."""
