"""What a model does on data that it was not fitted to: the tests of a sceptic."""
