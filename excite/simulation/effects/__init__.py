"""Effects that can be injected into a virtual robot, one file each, written from the physics."""
