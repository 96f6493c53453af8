"""Voices of services that stream sound with its times: parsers of their messages, and a client."""
