"""Is a database true, and is it smooth?"""
