"""One Bayesian variable selection over all effects that an arm's joint torques may show."""
