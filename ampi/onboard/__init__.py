"""What flies, first half: entry state → Reference. numpy alone; reads no file; never raises in flight."""
