"""Home: the session so far, the ways to a recording, the samples, and what the paper prints.

Streamlit imports this file when it starts, for `app`, and runs it whenever a browser asks for Home.
"""

if __name__ == "__main__":
    from pages.ui.components.frame import draw_page
    from pages.ui.home import show_page

    draw_page("", show_page)
else:
    from streamlit.starlette import App
    from uvicorn import Server

    from pages.ui.server import accept_few, lifespan, middleware

    accept_few(Server)
    app = App(__file__, middleware=middleware, lifespan=lifespan)
