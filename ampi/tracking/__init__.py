"""What flies, second half: Reference + navigation state → bank command. numpy alone."""
