#!/bin/sh
# Makes certificates to try TLS and mutual TLS with; not for the field, where keys are made where they stay.
#
#   sh make-test-certificates.sh FOLDER [NAME...]
#
# NAME: what the listening side is reached by, as DNS:router.example.org or IP:192.168.0.7; this machine if none.
# Gives ca.pem (what both sides trust), server.pem and server.key (the listening side), client, drone and ground
# likewise (connecting sides, for mutual TLS), each valid for 30 days; "streamkit test drone" is a common name.
set -eu
folder=$1
shift
names=$(printf '%s,' "${@:-DNS:localhost,IP:127.0.0.1}")
mkdir -p "$folder"
cd "$folder"
umask 077

openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 30 \
  -subj "/CN=streamkit test authority" -addext "basicConstraints=critical,CA:TRUE" \
  -addext "keyUsage=critical,keyCertSign" -keyout ca.key -out ca.pem 2>openssl.log

for side in server client drone ground; do
  openssl req -new -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes \
    -subj "/CN=streamkit test $side" -keyout "$side.key" -out "$side.csr" 2>>openssl.log
  use=client
  [ "$side" = server ] && use=server
  printf 'subjectAltName=%s\nextendedKeyUsage=%sAuth\n' "${names%,}" "$use" >"$side.ext"
  openssl x509 -req -in "$side.csr" -CA ca.pem -CAkey ca.key -CAcreateserial -days 30 \
    -extfile "$side.ext" -out "$side.pem" 2>>openssl.log
  rm "$side.csr" "$side.ext"
done
