"""What flies, first half: entry state → Reference. numpy alone; no files; no exceptions in flight."""
