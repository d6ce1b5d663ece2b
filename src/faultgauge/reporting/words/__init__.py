"""What is told of results, in sentences; none of it draws."""
