"""What far simpler predictors than a simulator reach on the rows that judge it."""
