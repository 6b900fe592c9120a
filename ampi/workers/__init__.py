"""Jobs in processes of their own, and what they keep on disk before a file is whole."""
