"""What flies, first half: parameters p → Reference. numpy alone; no files; no exceptions in flight."""
