"""The edge: parse a request, call one service, render. The JSON API and the pages."""
