"""What is told of judged rows: events, alarms, shares, evidence, the sentence."""
