"""What motions promise before anything is measured: precision of the parameters, and how much motion a target takes."""
