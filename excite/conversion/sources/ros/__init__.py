"""Messages of ROS and of Unitree, whichever library decodes them."""
