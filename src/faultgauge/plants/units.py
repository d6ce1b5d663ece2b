def check(spec):
    return []
