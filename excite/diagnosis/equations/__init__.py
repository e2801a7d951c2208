"""The joint torque equations: samples, baseline, noise floor, and the weighted fit of a hypothesis."""
