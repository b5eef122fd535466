"""The first tables."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def _text(name: str, length: int, null: bool = False, **more) -> sa.Column:
    return sa.Column(name, sa.String(length), nullable=null, **more)


def _number(name: str, type: Any = sa.Float, null: bool = False) -> sa.Column:
    return sa.Column(name, type(), nullable=null)


def upgrade() -> None:
    """Make them."""
    op.create_table("account", _text("owner", 64, primary_key=True), _number("stored_bytes", sa.BigInteger))
    op.create_table(
        "api_key",
        _text("id", 36, primary_key=True), _text("owner", 64), _text("digest", 64),
        _number("created"), _number("revoked", null=True),
        sa.UniqueConstraint("digest"),
    )  # fmt: skip
    op.create_table(
        "thing",
        _text("id", 36, primary_key=True), _text("owner", 64), _text("kind", 16), _text("name", 200),
        _number("bytes", sa.BigInteger), sa.Column("summary", sa.JSON(), nullable=False), _number("created"),
    )  # fmt: skip
    op.create_table(
        "stored_file",
        _text("key", 64, primary_key=True), _text("of", 64), _text("path", 400), _number("bytes", sa.BigInteger),
        _text("sha256", 64), _text("media_type", 100),
        sa.UniqueConstraint("of", "path"),
    )  # fmt: skip
    op.create_table(
        "job",
        _text("id", 36, primary_key=True), _text("owner", 64), _text("kind", 16),
        sa.Column("request", sa.JSON(), nullable=False), _text("state", 16), _number("created"),
        _number("handed_over", null=True), _number("handovers", sa.Integer), _number("attempt", sa.Integer),
        _number("crashes", sa.Integer), _text("worker", 36, null=True), _number("started", null=True),
        _number("finished", null=True), _number("part"), _text("words", 200), _number("exit_code", sa.Integer, True),
        _text("message", 8000), _number("bytes", sa.BigInteger),
    )  # fmt: skip
    op.create_table(
        "repeat",
        _text("owner", 64, primary_key=True), _text("key", 255, primary_key=True), _text("fingerprint", 64),
        _text("job", 36), _number("created"),
    )  # fmt: skip
    op.create_table(
        "worker",
        _text("id", 36, primary_key=True), _text("host", 255), _number("pid", sa.Integer), _number("started"),
        _number("beat"), _number("ended", null=True),
    )  # fmt: skip
    for table, column in INDEXES:
        op.create_index(f"ix_{table}_{column}", table, [column])


def downgrade() -> None:
    """Drop them."""
    for table in ("worker", "repeat", "job", "stored_file", "thing", "api_key", "account"):
        op.drop_table(table)


INDEXES = (
    ("api_key", "owner"), ("thing", "owner"), ("thing", "kind"), ("thing", "created"), ("stored_file", "of"),
    ("job", "owner"), ("job", "state"), ("job", "created"), ("job", "handed_over"), ("job", "worker"),
    ("job", "finished"), ("worker", "beat"),
)  # fmt: skip
