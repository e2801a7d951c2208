"""A person's segments identified beside the tables, and a weight that is worn, as in Jovic et al., T-RO 2016."""
