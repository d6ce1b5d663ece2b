"""What of a log is judged: dead times, flat lines, what of a row is believed, residuals."""
