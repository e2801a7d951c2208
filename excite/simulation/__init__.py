"""The virtual robot in MuJoCo, and effects that can be injected into it."""
