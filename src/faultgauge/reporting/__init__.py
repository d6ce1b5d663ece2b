"""Words, vector figures and the self-contained HTML report. Results in, text out.

What draws imports matplotlib and jinja2; commands do so only when they draw.
"""
